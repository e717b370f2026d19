//! The page `docs/configuration.md`.

use super::{concerned, value};
use crate::config::{KEYS, Key, Method, Range, Resume, SECTIONS};
use std::fmt::Write;

const BEGINNING: &str = "\
# Configuration

This page is written by `mamf settings --markdown`, from the table in `src/config/keys.rs` and the methods in
`src/config/method.rs`. In the terminal, `mamf settings` lists the keys, `mamf settings imagination` those of a section,
`mamf settings KEY` says everything about one, and `mamf settings --method td3` shows what a method has a use for.

## How settings come together

A configuration is a TOML file such as `configs/hopper.toml`. A key with a dot stands in a section: `imagination.decay_rate` is
`decay_rate` below `[imagination]`. Only `task` must be there. The value of a key is, in this order,

1. what the command line says: `--set KEY=VALUE`, as often as needed, the last one counts. The value is TOML or a bare word.
   `--seed N`, `--steps N` and `--threads N` are short for `--set seed=N`, `--set steps=N` and `--set compute.threads=N`;
2. what the file says;
3. the preset of the method (see below);
4. the default, which is the paper's figure (appendix B) where the paper states one.

The run directory holds the result as `config.toml`, with every key; `--config` takes it to make the same run again.

An unknown key, a value of a wrong type or out of range, and values that do not go together are errors. The message names
the key, where it stands, and what would be right; the exit code is 2, and nothing has been written.

A key that the method has no use for (a filter where nothing is imagined, a temperature for TD3) is refused too, as is
`imagination.decay_rate` while the decay is switched off, so that nobody waits for an effect that can't come. There are four exceptions:

- Every method accepts the keys of the dynamics model (`model`, `model_start`, `rules`) and `telemetry`, so that methods with and
  without a model can be compared under the same options.
- When an option picks another method than the file's, the file may say things that this method has no use for. They are passed over.
- A file may say how a component is set that is switched off.
- The `[settings]` of an experiment hold for those of its runs that have a use for them.

`--set method=td3` makes the baseline of any configuration. The `config.toml` of a run serves as well: where it repeats the preset of its
own method, the preset of the other method takes its place.
";

const RELATIONS: &str = "\
## What must hold between keys

- `batch_size` is at most `random_steps` and at most `replay.capacity`.
- `model_start` is at most `random_steps`, for methods with a dynamics model.
- `demonstrations.probability` and `demonstrations.reset_probability` are at most 1 together.
- `video.every` is a multiple of `evaluation.every`.
- `doubled_actions` and `demonstrations.path` exclude each other.
- `exploration.spread` has two different numbers only where `environments` is at least 2.

## Doubled actions

`[doubled_actions]` with a `period` may also stand at the task: `[task]` with `id = \"Hopper-v4\"` and
`doubled_actions = { period = 200 }`.

## Paper and released code

Where the paper and its released code differ, the default is that of the released code, but for `rules.velocity`, which
is \"start\" there. `imagination.readings = \"text\"` stands for the paper's text: `imagination.target_comparison =
\"greater_equal\"`, `imagination.uncertainty_scale = \"running_max\"`, `imagination.imaginary_loss_mean = \"kept\"`.

";

/// The page.
pub(super) fn page() -> String {
    let mut page = BEGINNING.to_owned();
    page += "\n## Keys\n";
    for (section, about) in SECTIONS {
        match *section {
            "" => write!(page, "\n### {about}\n\n"),
            section => write!(page, "\n### `[{section}]`: {about}\n\n"),
        }
        .expect("a string takes it");
        page += "| Key | Default | Range | Meaning |\n|---|---|---|---|\n";
        for key in KEYS.iter().filter(|key| key.section() == *section) {
            row(&mut page, key);
        }
    }
    page += "\n";
    page += RELATIONS;
    page += "## Presets of the methods\n\n| Method | What it is | Otherwise than the defaults |\n|---|---|---|\n";
    for method in Method::ALL {
        preset(&mut page, method);
    }
    page
}

fn row(page: &mut String, key: &Key) {
    let default = match (key.default(), key.range) {
        (Some(value), _) => format!("`{value}`"),
        (None, Range::Task) => "required".into(),
        (None, _) => "not set".into(),
    };
    let mut meaning = vec![key.doc().to_owned()];
    if key.concern.otherwise().is_some() {
        let methods = concerned(key).replace(", ", "`, `");
        meaning.push(format!("Only for `{methods}`."));
    }
    if let Some((switch, value)) = key.only_while {
        meaning.push(format!("Means something only while `{switch} = {value}`."));
    }
    match key.resume {
        Resume::Fixed => (),
        Resume::Forced => meaning.push("May change on `--resume` with `--force`.".into()),
        Resume::Free => meaning.push("May change on `--resume`.".into()),
    }
    let (name, range, meaning) = (key.name, key.range, meaning.join(" "));
    *page += &format!("| `{name}` | {default} | {range} | {meaning} |\n");
}

fn preset(page: &mut String, method: Method) {
    let keys = KEYS.iter().filter(|key| key.name != "method");
    let own: Vec<String> = keys
        .filter(|key| key.concern.includes(method) && value(key, Some(method)) != value(key, None))
        .map(|key| format!("`{} = {}`", key.name, value(key, Some(method))))
        .collect();
    let (name, summary) = (method.name(), method.definition().summary);
    *page += &format!("| `{name}` | {summary} | {} |\n", own.join(", "));
}
