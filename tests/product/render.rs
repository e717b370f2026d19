//! `mamf render` and videos of runs. Where nothing can draw, these tests say so and pass.

use crate::common::{Place, skipped, small_run, stderr};
use mamf::core::random::stream;
use mamf::env;
use mamf::render::{Film, Painter, Picture, available};
use mamf::task::Start;
use std::collections::HashSet;
use std::fs::File;
use std::process::Command;

/// Whether pictures can be drawn here.
fn can_draw() -> bool {
    match available() {
        Ok(_) => true,
        Err(error) => {
            skipped(&error.to_string());
            false
        }
    }
}

fn render<'a>(what: &[&'a str], out: &'a str) -> Vec<&'a str> {
    [&["render", "--size", "96x64", "--out", out], what].concat()
}

const REACHER: [&str; 4] = ["--task", "Reacher-v4", "--actions", "random"];

/// Width and height in the header of a PNG file.
fn png_size(bytes: &[u8]) -> [u32; 2] {
    assert_eq!(&bytes[..8], b"\x89PNG\r\n\x1a\n");
    [16, 20].map(|at| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()))
}

/// Width, height, and the delay of each frame in hundredths of a second.
fn gif(place: &Place, name: &str) -> ([u16; 2], Vec<u16>) {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::Indexed);
    let mut decoder = options
        .read_info(File::open(place.path(name)).unwrap())
        .unwrap();
    let size = [decoder.width(), decoder.height()];
    let mut delays = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        delays.push(frame.delay);
    }
    (size, delays)
}

#[test]
fn every_task_can_be_seen() {
    if !can_draw() {
        return;
    }
    for id in env::ids().filter(|id| !id.contains("Sparse")) {
        let mut env = env::make_inspect(id).unwrap();
        let spec = env.spec().clone();
        let mut observation = vec![0.0; spec.obs_size];
        env.reset(&mut stream(1, "env"), &mut observation);
        let mut film = Film::begin(env.as_ref());
        for _ in 0..5 {
            let step = env.step(&vec![0.5; spec.action_size], &mut observation);
            film.step(env.as_ref(), &step);
        }
        let mut painter = Painter::new(&spec, [160, 120], None).unwrap();
        let mut paint = |i: usize| painter.paint(&film.shots()[i]).unwrap();
        let first = paint(0);
        assert_eq!(first.rgb.len(), 160 * 120 * 3);
        let colours: HashSet<&[u8]> = first.rgb.chunks_exact(3).collect();
        assert!(colours.len() > 100, "{id}: {} colours", colours.len());
        assert_ne!(
            below_the_caption(&first),
            below_the_caption(&paint(5)),
            "{id}"
        );
        assert_eq!(paint(0), first, "{id}");
    }
}

/// The lower half of a picture.
fn below_the_caption(picture: &Picture) -> &[u8] {
    &picture.rgb[picture.rgb.len() / 2..]
}

#[test]
fn the_goal_is_drawn_where_it_is() {
    if !can_draw() {
        return;
    }
    for id in ["EggHandOver-v0", "TwoPenCatchUnderArm-v0"] {
        let mut env = env::make_inspect(id).unwrap();
        let spec = env.spec().clone();
        let mut observation = vec![0.0; spec.obs_size];
        env.reset(&mut stream(1, "env"), &mut observation);
        let (qpos, qvel) = (env.qpos().to_vec(), env.qvel().to_vec());
        let mut painter = Painter::new(&spec, [160, 120], None).unwrap();
        let mut picture = |seed| {
            let goal = env.draw_goal(&mut stream(seed, "goal"), &qpos);
            let start = Start {
                qpos: &qpos,
                qvel: &qvel,
                previous_action: None,
                goal: &goal,
            };
            env.start_at(&start, &mut observation);
            let film = Film::begin(env.as_ref());
            painter.paint(&film.shots()[0]).unwrap()
        };
        assert_ne!(picture(1), picture(2), "{id}");
        assert_eq!(picture(1), picture(1), "{id}");
    }
}

#[test]
fn pictures_come_in_every_format() {
    if !can_draw() {
        return;
    }
    let place = Place::new();
    let printed = place.succeed(&render(&REACHER, "first.png"));
    assert_eq!(printed, "first.png: 1 picture\n");
    place.succeed(&render(
        &[&REACHER[..], &["--steps", "20"]].concat(),
        "later.png",
    ));
    place.succeed(&render(
        &[&REACHER[..], &["--steps", "20"]].concat(),
        "again.png",
    ));
    let png = |name: &str| std::fs::read(place.path(name)).unwrap();
    assert_eq!(png_size(&png("first.png")), [96, 64]);
    assert_ne!(png("first.png"), png("later.png"));
    assert_eq!(png("again.png"), png("later.png"));

    // 51 states of 0.04 s, twice as fast, of two episodes.
    let fast = [&REACHER[..], &["--episodes", "2", "--speed", "2"]].concat();
    let printed = place.succeed(&render(&fast, "fast.gif"));
    let (size, delays) = gif(&place, "fast.gif");
    assert_eq!(size, [96, 64]);
    let seconds = f64::from(delays.iter().map(|d| u32::from(*d)).sum::<u32>()) / 100.0;
    let dt = env::make_inspect("Reacher-v4").unwrap().spec().dt;
    let expected = 2.0 * 51.0 * dt / 2.0;
    assert!((seconds - expected).abs() < 0.006, "{seconds} {expected}");
    assert_eq!(
        printed,
        format!("fast.gif: {} pictures, {expected:.2} s\n", delays.len())
    );

    let every = [&REACHER[..], &["--every", "10"]].concat();
    place.succeed(&render(&every, "frames/"));
    let names: Vec<String> = place
        .contents("frames")
        .keys()
        .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    let expected: Vec<String> = (1..=6).map(|i| format!("frame_{i:05}.png")).collect();
    assert_eq!(names, expected);
    // An existing directory may hold other things.
    std::fs::create_dir(place.path("there")).unwrap();
    place.write("there/notes.txt", "mine");
    place.succeed(&render(&[&every[..], &["--steps", "10"]].concat(), "there"));
    assert_eq!(place.contents("there").len(), 3);
    assert_eq!(place.read("there/notes.txt"), "mine");

    let leftovers = |path: &std::path::PathBuf| path.to_string_lossy().ends_with(".tmp");
    assert!(!place.contents("").keys().any(leftovers));
}

#[test]
fn videos_are_made_by_ffmpeg_or_not_at_all() {
    if !can_draw() {
        return;
    }
    let place = Place::new();
    if Command::new("ffmpeg").arg("-version").output().is_ok() {
        place.succeed(&render(&REACHER, "x.mp4"));
        let bytes = std::fs::read(place.path("x.mp4")).unwrap();
        assert_eq!(&bytes[4..8], b"ftyp");
        place.refuse(2, &render(&REACHER, "x.mp4"), &["x.mp4", "exists already"]);
    } else {
        println!("not tried: ffmpeg is not installed");
    }
    // Without it: nowhere to look for programs.
    let mut command = place.command(&render(&REACHER, "y.mp4"));
    let output = command.env("PATH", place.path("nowhere")).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    let message = stderr(&output);
    assert!(
        message.contains("y.mp4") && message.contains("ffmpeg"),
        "{message}"
    );
    assert!(message.contains(".gif"), "{message}");
    assert!(
        !place
            .contents("")
            .keys()
            .any(|path| path.ends_with("y.mp4"))
    );
    let mut wrong = render(&REACHER, "z.mp4");
    wrong[2] = "95x64";
    place.refuse(2, &wrong, &["z.mp4", "95x64", "even"]);
}

#[test]
fn an_ffmpeg_that_talks_without_end_holds_nothing_up() {
    use std::os::unix::fs::PermissionsExt;
    if !can_draw() {
        return;
    }
    let place = Place::new();
    std::fs::create_dir(place.path("bin")).unwrap();
    // More than any pipe holds, before it takes a picture.
    let script = "#!/bin/sh\nhead -c 3000000 /dev/zero | tr '\\0' x >&2\ncat > /dev/null\n";
    let path = format!("{}:/usr/bin:/bin", place.path("bin").display());
    let run = |ending: &str, out: &str| {
        place.write("bin/ffmpeg", format!("{script}{ending}"));
        let executable = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(place.path("bin/ffmpeg"), executable).unwrap();
        let mut command = place.command(&render(&REACHER, out));
        command.env("PATH", &path).output().unwrap()
    };
    let made = run(
        "for last; do :; done\necho video > \"${last#file:}\"\n",
        "x.mp4",
    );
    assert!(made.status.success(), "{:.500}", stderr(&made));
    assert_eq!(place.read("x.mp4"), "video\n");
    let failed = run("echo no such codec >&2\nexit 1\n", "y.mp4");
    assert_eq!(failed.status.code(), Some(1));
    let said = stderr(&failed);
    assert!(
        said.contains("y.mp4") && said.contains("no such codec"),
        "{said:.500}"
    );
    assert!(!place.path("y.mp4").exists());
}

#[test]
fn an_interrupt_leaves_nothing_behind() {
    if !can_draw() {
        return;
    }
    let place = Place::new();
    for out in ["x.gif", "frames/"] {
        let ant = ["--task", "Ant-v4", "--every", "1", "--episodes", "100"];
        let mut child = place.command(&render(&ant, out)).spawn().unwrap();
        let begun = || place.contents("").values().any(|bytes| !bytes.is_empty());
        for _ in 0..600 {
            if begun() || child.try_wait().unwrap().is_some() {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(100));
        }
        let id = child.id().to_string();
        Command::new("kill").args(["-INT", &id]).status().unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(130), "{out}");
        assert!(place.contents("").is_empty(), "{out}");
    }
}

#[test]
fn recordings_are_drawn_from_their_states() {
    if !can_draw() {
        return;
    }
    let place = Place::new();
    for name in ["EggHandOver", "PenSpin", "Hopper"] {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/rollouts");
        let file = format!("{folder}/{name}.npz");
        let out = format!("{name}.gif");
        place.succeed(&render(&["--demonstration", &file], &out));
        let (size, delays) = gif(&place, &out);
        assert_eq!(size, [96, 64]);
        assert!(delays.len() > 1, "{name}");
    }
    let missing = ["--demonstration", "no.npz"];
    place.refuse(2, &render(&missing, "no.gif"), &["no.json"]);
}

#[test]
fn policies_are_drawn_and_training_can_record_them() {
    let place = Place::new();
    let video = ["video.every=200", "evaluation.every=100"];
    place.succeed(&small_run("reacher", "plain", &[]));
    if !can_draw() {
        return;
    }
    place.succeed(&small_run("reacher", "filmed", &video));
    for curves in ["train.csv", "eval.csv"] {
        let read = |run: &str| place.read(&format!("{run}/{curves}"));
        assert!(read("plain") == read("filmed"), "{curves} differs");
    }
    let videos: Vec<_> = place.contents("filmed/videos").into_keys().collect();
    let name = |step: u64| place.path(&format!("filmed/videos/step_{step:09}.gif"));
    assert_eq!(videos, [name(0), name(200), name(400)]);
    let (size, delays) = gif(&place, "filmed/videos/step_000000200.gif");
    assert_eq!(size, [480, 360]);
    assert!(delays.len() > 10);
    assert!(!place.path("plain/videos").exists());

    let checkpoint = ["--checkpoint", "plain", "--episodes", "3"];
    place.succeed(&render(&checkpoint, "policy.gif"));
    place.succeed(&render(&checkpoint, "again.gif"));
    let read = |name: &str| std::fs::read(place.path(name)).unwrap();
    assert!(read("policy.gif") == read("again.gif"));

    // A new run in its place begins without videos.
    let mut forced = small_run("reacher", "filmed", &[]);
    forced.push("--force".into());
    place.succeed(&forced);
    assert!(!place.path("filmed/videos").exists());
}

#[test]
fn training_without_a_renderer_is_refused_videos_only() {
    let place = Place::new();
    let train = |settings: &[&str]| {
        let mut command = place.command(&small_run("reacher", "run", settings));
        command.env("MUJOCO_GL", "glfw").output().unwrap()
    };
    let output = train(&["video.every=100"]);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(stderr(&output).contains("MUJOCO_GL=glfw"), "{output:?}");
    assert!(!place.path("run").exists());
    assert_eq!(train(&[]).status.code(), Some(0));
    place.refuse(
        2,
        &small_run("reacher", "other", &["video.every=150"]),
        &["video.every", "150", "multiple of evaluation.every (100)"],
    );
}

#[test]
fn mistakes_are_explained_and_write_nothing() {
    let place = Place::new();
    place.write("x.png", "mine");
    std::fs::create_dir(place.path("full")).unwrap();
    place.write("full/frame_00007.png", "mine");
    let refuse = |what: &[&str], out: &str, parts: &[&str]| {
        place.refuse(2, &render(what, out), parts);
    };
    for (option, value) in [("--size", "0x4"), ("--size", "64"), ("--size", "64x4097")] {
        let mut arguments = render(&REACHER, "y.png");
        arguments[1..3].copy_from_slice(&[option, value]);
        place.refuse(2, &arguments, &[option, value, "1 to 4096"]);
    }
    refuse(
        &["--task", "Reachr-v4"],
        "y.png",
        &["did you mean `Reacher-v4`?"],
    );
    refuse(&REACHER, "y.webm", &["y.webm", ".png, .gif or .mp4"]);
    let speed = [&REACHER[..], &["--speed", "0"]].concat();
    refuse(&speed, "y.gif", &["--speed", "0.01 to 100"]);
    let many = [&REACHER[..], &["--episodes", "2"]].concat();
    refuse(&many, "y.png", &["--episodes 2", "one picture"]);
    refuse(&["--checkpoint", "nowhere"], "y.png", &["nowhere"]);
    refuse(&["--episodes", "1"], "y.png", &["--task", "--checkpoint"]);
    let both = ["--task", "Ant-v4", "--checkpoint", "run"];
    refuse(&both, "y.png", &["cannot be used with"]);

    let mut command = place.command(&render(&REACHER, "y.png"));
    let output = command.env("MUJOCO_GL", "vulkan").output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(stderr(&output).contains("MUJOCO_GL=vulkan"), "{output:?}");

    if !can_draw() {
        return;
    }
    refuse(&REACHER, "x.png", &["x.png", "exists already"]);
    refuse(&REACHER, "full", &["frame_00007.png", "exists already"]);
    let camera = [&REACHER[..], &["--camera", "behind"]].concat();
    refuse(&camera, "y.png", &["`behind`", "`above`"]);
    // A directory that is not there.
    place.refuse(2, &render(&REACHER, "no/where/y.png"), &["no/where/y.png"]);
}
