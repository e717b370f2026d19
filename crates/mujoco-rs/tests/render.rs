//! Pictures without a display. Where no OpenGL library is installed, these tests say so and pass.

use std::env;
use std::process::Command;

use mujoco_rs::render::{
    Camera, Caption, Corner, LARGEST_SIDE, Picture, RenderError, Renderer, VARIABLE, available,
};
use mujoco_rs::{Model, Object};

const SIZE: [usize; 2] = [160, 120];

/// A red ball that slides along x, over a floor, seen from the side.
const BALL: &str = "<mujoco><visual><quality shadowsize='512'/></visual><worldbody><light pos='0 0 3'/>\
    <camera name='side' pos='0 -2 0.5' xyaxes='1 0 0 0 0 1'/>\
    <camera name='away' pos='0 -2 0.5' xyaxes='-1 0 0 0 0 1'/>\
    <geom type='plane' size='2 2 1' rgba='0.2 0.3 0.4 1'/>\
    <body pos='0 0 0.5'><joint type='slide' axis='1 0 0'/><geom size='0.3' rgba='1 0 0 1'/></body>\
    <body pos='0 0 1'><geom size='0.1' group='2' rgba='0 1 0 1' contype='0'/></body>\
    </worldbody></mujoco>";

fn ball() -> Model {
    Model::from_xml(BALL).unwrap()
}

/// Whether pictures can be drawn here.
fn can_draw() -> bool {
    match available() {
        Ok(_) => true,
        Err(error) => {
            println!("skipped: {error}");
            false
        }
    }
}

fn renderer() -> Renderer {
    let model = ball();
    let mut renderer = Renderer::new(&model, SIZE).unwrap();
    renderer.set_camera(Camera::Model(model.id(Object::Camera, "side").unwrap()));
    renderer
}

fn pixel(picture: &Picture, x: usize, y: usize) -> [u8; 3] {
    let at = 3 * (y * picture.width + x);
    [0, 1, 2].map(|i| picture.rgb[at + i])
}

fn is_red([r, g, b]: [u8; 3]) -> bool {
    r > 60 && r > 2 * g && r > 2 * b
}

#[test]
fn a_picture_shows_what_is_there_the_right_way_up() {
    if !can_draw() {
        return;
    }
    let picture = renderer().picture(&[0.0], &[]).unwrap();
    assert_eq!([picture.width, picture.height], SIZE);
    assert_eq!(picture.rgb.len(), 160 * 120 * 3);
    assert!(is_red(pixel(&picture, 80, 60)), "the ball is in the middle");
    assert!(!is_red(pixel(&picture, 5, 5)));
    assert!(!is_red(pixel(&picture, 5, 115)));
    let [_, green, _] = pixel(&picture, 80, 22);
    assert!(green > 60, "the small ball is above it");
}

#[test]
fn the_same_pose_gives_the_same_bytes_and_another_pose_others() {
    if !can_draw() {
        return;
    }
    let mut first = renderer();
    let middle = first.picture(&[0.0], &[]).unwrap();
    let right = first.picture(&[0.7], &[]).unwrap();
    assert!(
        !is_red(pixel(&right, 65, 60)),
        "the ball moved to the right"
    );
    assert!(
        is_red(pixel(&right, 110, 60)),
        "the ball moved to the right"
    );
    assert_eq!(first.picture(&[0.0], &[]).unwrap(), middle);
    // Two renderers of one thread do not disturb each other.
    let mut second = renderer();
    assert_eq!(second.picture(&[0.7], &[]).unwrap(), right);
    assert_eq!(first.picture(&[0.0], &[]).unwrap(), middle);
    drop(first);
    assert_eq!(second.picture(&[0.0], &[]).unwrap(), middle);
}

#[test]
fn a_camera_that_follows_leaves_no_trace_of_where_it_was() {
    if !can_draw() {
        return;
    }
    let xml = BALL.replace(
        "<joint",
        "<camera name='track' mode='trackcom' pos='0 -2 0.5'/><joint",
    );
    let model = Model::from_xml(&xml).unwrap();
    let mut renderer = Renderer::new(&model, SIZE).unwrap();
    renderer.set_camera(Camera::Model(model.id(Object::Camera, "track").unwrap()));
    let first = renderer.picture(&[0.0], &[]).unwrap();
    renderer.picture(&[50.0], &[]).unwrap();
    assert_eq!(renderer.picture(&[0.0], &[]).unwrap(), first);
}

#[test]
fn every_thread_may_draw() {
    if !can_draw() {
        return;
    }
    let middle = renderer().picture(&[0.0], &[]).unwrap();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| assert_eq!(renderer().picture(&[0.0], &[]).unwrap(), middle));
        }
    });
}

#[test]
fn cameras_groups_and_captions_change_the_picture() {
    if !can_draw() {
        return;
    }
    let model = ball();
    let mut renderer = renderer();
    let plain = renderer.picture(&[0.0], &[]).unwrap();

    let caption = |text: &str| Caption {
        corner: Corner::TopLeft,
        left: text.to_owned(),
        right: "1\n2".to_owned(),
    };
    let captions = [caption("step\nreturn")];
    let written = renderer.picture(&[0.0], &captions).unwrap();
    assert_ne!(written, plain);
    let rows = 60 * 160 * 3;
    assert_eq!(written.rgb[rows..], plain.rgb[rows..], "only the corner");
    // Long, strange and empty texts are no danger.
    for text in ["", "\u{e9}\0", &"long ".repeat(1000)] {
        renderer.picture(&[0.0], &[caption(text)]).unwrap();
    }

    renderer.show_group(2, false);
    let hidden = renderer.picture(&[0.0], &[]).unwrap();
    assert_ne!(pixel(&hidden, 80, 22), pixel(&plain, 80, 22));
    renderer.show_group(2, true);
    renderer.show_group(99, true);
    assert_eq!(renderer.picture(&[0.0], &[]).unwrap(), plain);

    let away = model.id(Object::Camera, "away").unwrap();
    for camera in [Camera::Model(away), Camera::Overview] {
        renderer.set_camera(camera);
        assert_ne!(renderer.picture(&[0.0], &[]).unwrap(), plain);
    }
    let overview = renderer.picture(&[0.0], &[]).unwrap();
    renderer.set_camera(Camera::Model(99));
    assert_eq!(renderer.picture(&[0.0], &[]).unwrap(), overview);
}

#[test]
fn any_sane_size_can_be_had_and_no_other() {
    if !can_draw() {
        return;
    }
    let model = ball();
    for size in [[1, 1], [333, 77], [1920, 1080], [LARGEST_SIDE, 16]] {
        let mut renderer = Renderer::new(&model, size).unwrap();
        let picture = renderer.picture(&[0.0], &[]).unwrap();
        assert_eq!(picture.rgb.len(), size[0] * size[1] * 3);
    }
    for size in [[0, 10], [10, 0], [LARGEST_SIDE + 1, 10]] {
        let error = Renderer::new(&model, size).unwrap_err();
        assert_eq!(error, RenderError::Size(size[0], size[1]));
        assert!(error.to_string().contains("1 to 4096"), "{error}");
    }
    let error = renderer().picture(&[0.0, 1.0], &[]).unwrap_err();
    assert!(error.to_string().starts_with("2 positions"), "{error}");
}

#[test]
fn renderers_come_and_go() {
    if !can_draw() {
        return;
    }
    let before = resident_kilobytes();
    for _ in 0..20 {
        renderer().picture(&[0.0], &[]).unwrap();
    }
    let grown = resident_kilobytes().saturating_sub(before);
    println!("20 renderers left {grown} kB behind");
    assert!(grown < 150_000, "20 renderers left {grown} kB behind");
}

/// Memory of this process; 0 where the system does not say.
fn resident_kilobytes() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let number = line.and_then(|line| line.split_whitespace().next()?.parse().ok());
    number.unwrap_or(0)
}

/// Runs the tests above in a process with that library forced; what became of them, and what was said.
fn with_library(library: &str) -> (bool, String) {
    let output = Command::new(env::current_exe().unwrap())
        .args(["--nocapture", "--test-threads=2"])
        .args(["--skip", "library"])
        .env(VARIABLE, library)
        .output()
        .unwrap();
    let text = [output.stdout, output.stderr].concat();
    let text = String::from_utf8_lossy(&text).into_owned();
    (output.status.success(), text)
}

#[test]
fn a_library_can_be_forced() {
    for library in ["egl", "osmesa"] {
        let (passed, text) = with_library(library);
        assert!(passed, "{library}: {text}");
        if let Some(skipped) = text.lines().find(|line| line.starts_with("skipped")) {
            println!("{skipped}");
            assert!(skipped.contains(&format!("{VARIABLE}={library}: ")));
            assert!(skipped.contains("install `lib"), "{skipped}");
        }
    }
}

#[test]
fn no_other_library_can_be_forced() {
    let (passed, text) = with_library("glfw");
    assert!(passed, "{text}");
    assert!(
        text.contains("skipped: MUJOCO_GL=glfw: it must be `egl`, `osmesa` or unset"),
        "{text}"
    );
}
