//! The documentation says what the program does, and its links lead somewhere.

use mamf::config::Method;
use mamf::core::span::in_words;
use mamf::env;
use std::path::{Path, PathBuf};

/// The cells of every row of every table of a page, without quotation marks for code.
fn rows(page: &str) -> Vec<Vec<String>> {
    page.lines()
        .filter_map(|line| line.strip_prefix("| ")?.strip_suffix(" |"))
        .map(|line| line.split(" | ").map(|cell| cell.replace('`', "")))
        .map(Iterator::collect)
        .collect()
}

/// The pages that a newcomer reads.
fn pages() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let docs = std::fs::read_dir(root.join("docs")).unwrap();
    let docs = docs.map(|entry| entry.unwrap().path());
    let others = ["README.md", "assets/README.md", "results/README.md"];
    docs.chain(others.map(|page| root.join(page))).collect()
}

#[test]
fn every_link_leads_to_a_file() {
    let mut seen = 0;
    for page in pages() {
        let text = std::fs::read_to_string(&page).unwrap();
        for (_, link) in text
            .match_indices("](")
            .map(|(at, _)| text.split_at(at + 2))
        {
            let link = link.split(')').next().unwrap();
            if link.contains("://") {
                continue;
            }
            let file = page.parent().unwrap().join(link);
            assert!(file.exists(), "{}: {link}", page.display());
            seen += 1;
        }
    }
    assert!(seen > 20, "{seen} links");
}

#[test]
fn every_path_that_is_named_is_there() {
    const FOLDERS: [&str; 7] = [
        "src/", "tests/", "configs/", "scripts/", "crates/", "docs/", "benches/",
    ];
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut seen = 0;
    for page in pages() {
        let text = std::fs::read_to_string(&page).unwrap();
        // Words, in prose and in commands, without the marks around them.
        let words = text.split(|c: char| c.is_whitespace() || "`()|,;'\"".contains(c));
        for word in words.map(|word| word.trim_end_matches(['.', ':'])) {
            if FOLDERS.iter().any(|folder| word.starts_with(folder)) {
                assert!(root.join(word).exists(), "{}: {word}", page.display());
                seen += 1;
            }
        }
    }
    assert!(seen > 50, "{seen} paths");
}

/// All sources below a folder, one after the other.
fn sources(folder: &Path) -> String {
    let entries = std::fs::read_dir(folder).unwrap();
    let texts = entries.map(|entry| entry.unwrap().path()).map(|path| {
        if path.is_dir() {
            return sources(&path);
        }
        let is_source = path.extension().is_some_and(|ending| ending == "rs");
        if is_source {
            std::fs::read_to_string(&path).unwrap()
        } else {
            String::new()
        }
    });
    texts.collect()
}

#[test]
fn every_test_that_shows_a_promise_is_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let sources = ["src", "tests"]
        .map(|folder| sources(&root.join(folder)))
        .concat();
    let page = include_str!("../../docs/durability.md");
    let named = page.split('`').skip(1).step_by(2);
    let named = named.filter_map(|name| {
        ["trainer: ", "resume: ", "slurm: "]
            .iter()
            .find_map(|file| name.strip_prefix(file))
    });
    let mut seen = 0;
    for name in named {
        // A long one may be cut short.
        let is_there = match name.strip_suffix('…') {
            Some(beginning) => sources.contains(&format!("fn {beginning}")),
            None => sources.contains(&format!("fn {name}(")),
        };
        assert!(is_there, "{name}");
        seen += 1;
    }
    assert!(seen > 20, "{seen} tests");
}

#[test]
fn the_readme_is_short() {
    let length = include_str!("../../README.md").len();
    assert!(length <= 10_000, "{length} bytes; details belong to docs/");
}

#[test]
fn every_method_is_listed() {
    let rows = rows(include_str!("../../docs/methods.md"));
    for method in Method::ALL {
        let found = rows.iter().any(|row| row[0] == method.name());
        assert!(found, "{} is not in the documentation", method.name());
    }
}

#[test]
fn every_task_is_listed_with_its_sizes() {
    let rows = rows(include_str!("../../docs/tasks.md"));
    for id in env::ids() {
        let (task, _) = env::make(id).unwrap();
        let spec = task.spec();
        // A sparse variant stands in the row of the task it varies.
        let listed = id.replace("Sparse", "");
        let row = rows.iter().find(|row| row[0] == listed);
        let row = row.unwrap_or_else(|| panic!("{id} is not in the documentation"));
        let sizes = [spec.obs_size, spec.action_size];
        assert_eq!(row[1..3], sizes.map(|n| n.to_string()), "{id}");
        assert_eq!(
            row[3],
            in_words(&spec.action_ranges).replace("+-", "±"),
            "{id}"
        );
        assert_eq!(row[4], spec.max_episode_steps.to_string(), "{id}");
        let dt: f64 = row[5].parse().unwrap();
        assert!((dt - spec.dt).abs() < 1e-9, "{id}");
    }
}

/// The tables of the columns of all curves, as `docs/runs.md` holds them.
fn columns() -> String {
    use mamf::run::schema::{Column, EVAL, EVAL_CSV, Of, TIMING, TIMING_CSV, TRAIN, TRAIN_CSV};
    let table = |file: &str, columns: &[Column]| {
        let mut text = format!("**`{file}`**\n\n| Column | Meaning |\n|---|---|\n");
        for Column { name, of, doc } in columns {
            let mean = if *of == Of::Mean {
                "mean since the row before: "
            } else {
                ""
            };
            text += &format!("| `{name}` | {mean}{doc} |\n");
        }
        text
    };
    [
        table(EVAL_CSV, &EVAL),
        table(TRAIN_CSV, &TRAIN),
        table(TIMING_CSV, &TIMING),
    ]
    .join("\n")
}

#[test]
fn every_column_is_documented_as_the_program_knows_it() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/runs.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let begin = "<!-- columns, from src/run/schema.rs -->\n";
    let (before, rest) = page.split_once(begin).unwrap();
    let (found, after) = rest.split_once("<!-- end -->").unwrap();
    let wanted = columns();
    if std::env::var_os("MAMF_WRITE_DOCS").is_some() {
        std::fs::write(&path, format!("{before}{begin}{wanted}<!-- end -->{after}")).unwrap();
        return;
    }
    assert_eq!(
        found, wanted,
        "docs/runs.md; MAMF_WRITE_DOCS=1 cargo test --release --test product every_column writes it"
    );
}
