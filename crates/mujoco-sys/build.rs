//! Finds MuJoCo, generates its bindings and compiles the error guard.

use std::env;
use std::path::{Path, PathBuf};
use std::process::exit;

const INSTALL: &str = "install `libmujoco-dev` (Debian) or set MUJOCO_DIR to a folder that holds \
                       include/mujoco/mujoco.h and lib/libmujoco.so";

/// Ends the build with one sentence for the user.
///
/// Cargo fails the build because of the logged error; a status other than 0 would bury the sentence
/// in a dump of everything this script printed.
fn fail(message: &str) -> ! {
    println!("cargo::error={message}");
    exit(0);
}

fn main() {
    println!("cargo::rerun-if-env-changed=MUJOCO_DIR");
    println!("cargo::rerun-if-changed=wrapper.h");
    println!("cargo::rerun-if-changed=shim");
    let root = env::var_os("MUJOCO_DIR").map(PathBuf::from);

    let include = include_dir(root.as_deref());
    link(root.as_deref());
    cc::Build::new()
        .file("shim/guard.c")
        .include(&include)
        .warnings(true)
        .compile("mjguard");
    generate(&include);
}

/// The folder in which `mujoco/mujoco.h` lies.
fn include_dir(root: Option<&Path>) -> PathBuf {
    let places = match root {
        Some(root) => vec![root.join("include")],
        None => vec!["/usr/include".into(), "/usr/local/include".into()],
    };
    match places.iter().find(|p| p.join("mujoco/mujoco.h").is_file()) {
        Some(place) => place.clone(),
        None => fail(&format!(
            "the MuJoCo header mujoco/mujoco.h was not found in {}: {INSTALL}",
            list(&places)
        )),
    }
}

/// Tells the linker where the library is, after making sure that it is there.
fn link(root: Option<&Path>) {
    let place = match root {
        Some(root) => root.join("lib"),
        None => match searched_by_compiler("libmujoco.so") {
            Some(file) => file.parent().map(Path::to_path_buf).unwrap_or_default(),
            None => fail(&format!(
                "the MuJoCo library libmujoco.so was not found by the linker: {INSTALL}"
            )),
        },
    };
    let names = ["libmujoco.so", "libmujoco.dylib", "mujoco.lib"];
    if !names.iter().any(|name| place.join(name).exists()) {
        fail(&format!(
            "the MuJoCo library libmujoco.so was not found in {}: {INSTALL}",
            place.display()
        ));
    }
    println!("cargo::rustc-link-search=native={}", place.display());
    println!("cargo::rustc-link-lib=dylib=mujoco");
    println!("cargo::metadata=libdir={}", place.display());
}

/// Where the C compiler would find the library `name`.
fn searched_by_compiler(name: &str) -> Option<PathBuf> {
    let output = cc::Build::new()
        .cargo_metadata(false)
        .try_get_compiler()
        .ok()?
        .to_command()
        .arg(format!("-print-file-name={name}"))
        .output()
        .ok()?;
    let path = PathBuf::from(String::from_utf8(output.stdout).ok()?.trim());
    path.is_absolute().then_some(path)
}

fn generate(include: &Path) {
    let builder = bindgen::Builder::default()
        .header("wrapper.h")
        .clang_arg(format!("-I{}", include.display()))
        .allowlist_function("(mj|mju|mjv|mjr|mjguard)_.*")
        .allowlist_type("mj.*")
        .allowlist_var("mj[A-Z].*|mju_user_.*|mjguard_layout")
        .prepend_enum_name(false)
        .parse_callbacks(Box::new(bindgen::CargoCallbacks::new()));

    // A missing libclang is a panic inside bindgen; its message is long and hides the remedy.
    std::panic::set_hook(Box::new(|_| {}));
    let generated = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| builder.generate()));
    let _ = std::panic::take_hook();
    let bindings = match generated {
        Ok(Ok(bindings)) => bindings,
        Ok(Err(error)) => fail(&format!(
            "the MuJoCo headers in {} could not be read ({error}): {INSTALL}",
            include.display()
        )),
        Err(_) => fail(
            "libclang, which reads the MuJoCo headers, was not found: install `libclang-dev` \
             (Debian) or set LIBCLANG_PATH to the folder of libclang.so",
        ),
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default()).join("bindings.rs");
    if let Err(error) = bindings.write_to_file(&out) {
        fail(&format!("cannot write {}: {error}", out.display()));
    }
}

fn list(places: &[PathBuf]) -> String {
    let names: Vec<_> = places.iter().map(|p| p.display().to_string()).collect();
    names.join(" or ")
}
