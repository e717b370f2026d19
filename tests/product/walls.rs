//! The walls of the house: which rooms of `src` know which. A room uses rooms on lower floors alone.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// The rooms of each floor, the ground floor first.
const FLOORS: [&[&str]; 11] = [
    &["core"],
    &["nn", "task"],
    &["model", "replay"],
    &["agent", "env"],
    &["planning"],
    &["config", "recordings"],
    &["run", "render"],
    &["training"],
    &["lab"],
    &["cli"],
    &["main"],
];

/// Pairs that must not know each other whatever their floors say.
const NEVER: [(&str, &str); 8] = [
    ("run", "agent"),
    ("run", "env"),
    ("lab", "training"),
    ("lab", "agent"),
    ("env", "nn"),
    ("cli", "nn"),
    ("recordings", "nn"),
    ("render", "nn"),
];

fn floor(room: &str) -> usize {
    let found = FLOORS.iter().position(|rooms| rooms.contains(&room));
    found.unwrap_or_else(|| {
        panic!("src/{room} is no room of the house: give it a floor in tests/product/walls.rs")
    })
}

/// Why a file of the room `from` must not use the room `to`.
fn broken(from: &str, to: &str) -> Option<String> {
    if from == to {
        return None;
    }
    if NEVER.contains(&(from, to)) {
        return Some(format!("{from} never uses {to}"));
    }
    (floor(to) >= floor(from)).then(|| {
        format!(
            "{from} (floor {}) uses {to} (floor {}); a room knows only rooms below it",
            floor(from),
            floor(to)
        )
    })
}

/// The rooms that a source names by `crate::room`, tests of the same file left out.
fn used(source: &str) -> Vec<String> {
    let product = source
        .split("#[cfg(test)]\nmod ")
        .next()
        .unwrap_or_default();
    let code = product
        .lines()
        .map(|line| line.split("//").next().unwrap_or_default());
    let code: String = code
        .collect::<Vec<_>>()
        .join("\n")
        .replace("mamf::", "crate::");
    code.split("crate::").skip(1).flat_map(rooms).collect()
}

/// The first names of what follows `crate::`: one, or those of a list in braces.
fn rooms(after: &str) -> Vec<String> {
    let name = |text: &str| -> String {
        let text = text.trim_start().chars();
        text.take_while(|c| c.is_ascii_alphanumeric() || *c == '_')
            .collect()
    };
    let Some(list) = after.strip_prefix('{') else {
        return vec![name(after)];
    };
    let (mut rooms, mut depth) = (vec![name(list)], 0);
    for (i, c) in list.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            ',' if depth == 0 => rooms.push(name(&list[i + 1..])),
            _ => (),
        }
    }
    // A comma may come last.
    rooms.retain(|room| !room.is_empty());
    rooms
}

fn sources(directory: &Path, found: &mut Vec<(String, String)>) {
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            let name = path.to_str().unwrap().to_owned();
            // Tests that lie in a file of their own.
            if !name.ends_with("tests.rs") {
                found.push((name, fs::read_to_string(&path).unwrap()));
            }
        }
    }
}

#[test]
fn no_wall_is_broken() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut rooms = BTreeMap::new();
    for entry in fs::read_dir(&root).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        if name != "lib" {
            rooms.insert(name, path);
        }
    }
    let mut broken_walls = Vec::new();
    let mut seen = 0;
    for (room, path) in &rooms {
        let mut files = Vec::new();
        if path.is_dir() {
            sources(path, &mut files);
        } else {
            files.push((
                path.display().to_string(),
                fs::read_to_string(path).unwrap(),
            ));
        }
        for (file, source) in files {
            for other in used(&source) {
                seen += 1;
                let why = broken(room, &other);
                broken_walls.extend(why.map(|why| format!("{file}: {why}")));
            }
        }
    }
    assert!(
        seen > 200,
        "only {seen} uses were found: are they read at all?"
    );
    assert!(broken_walls.is_empty(), "\n{}", broken_walls.join("\n"));
}

#[test]
fn a_broken_wall_is_noticed_and_named() {
    let source = "//! See crate::training.\nuse crate::{nn::{Mlp, Adam}, env::Scene,};\nuse crate::task::Spec;\n\
                  fn f() { crate::cli::run() }\n#[cfg(test)]\nuse crate::core;\n#[cfg(test)]\nmod tests { use crate::lab; }";
    assert_eq!(used(source), ["nn", "env", "task", "cli", "core"]);
    assert_eq!(broken("agent", "nn"), None);
    assert_eq!(broken("agent", "agent"), None);
    assert!(
        broken("agent", "env")
            .unwrap()
            .contains("agent (floor 3) uses env")
    );
    assert!(broken("replay", "env").is_some() && broken("model", "replay").is_some());
    assert_eq!(broken("run", "agent").unwrap(), "run never uses agent");
}
