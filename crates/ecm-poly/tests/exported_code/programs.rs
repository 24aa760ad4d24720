//! Folders of a test run, and the programs that it starts.

use std::path::{Path, PathBuf};
use std::process::Command;

use ecm_poly::export::SourceFile;

/// An empty folder of this test run.
pub fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if path.exists() {
        std::fs::remove_dir_all(&path).unwrap();
    }
    std::fs::create_dir_all(&path).unwrap();
    path
}

pub fn write(folder: &Path, files: &[SourceFile]) {
    for file in files {
        let path = folder.join(&file.path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, &file.text).unwrap();
    }
}

/// Runs a command and returns its exit code and everything it said.
pub fn run(command: &mut Command) -> (Option<i32>, String) {
    let output = command.output().unwrap();
    let said = [output.stdout, output.stderr].concat();
    (
        output.status.code(),
        String::from_utf8_lossy(&said).into_owned(),
    )
}

/// Whether a program is there; otherwise the test says that it is skipped, or fails where every
/// program is required.
pub fn installed(program: &str, test: &str) -> bool {
    if Command::new(program).arg("--version").output().is_ok() {
        return true;
    }
    let required = std::env::var("ECM_REQUIRE_PROGRAMS").is_ok_and(|value| value == "1");
    assert!(!required, "{program} is not installed (see apt.txt)");
    eprintln!("SKIPPED {test}: no {program} on this machine");
    false
}

/// Compiles C sources of a folder without a warning and returns the exit code of the program.
pub fn checked(folder: &Path, level: &str, sources: &[String]) -> Option<i32> {
    let (code, said) = run(Command::new("gcc")
        .args(["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wpedantic"])
        .args(["-Werror", level, "-o", "check"])
        .args(sources)
        .current_dir(folder));
    assert_eq!(code, Some(0), "{sources:?}: {said}");
    run(&mut Command::new(folder.join("check"))).0
}

/// Arduino and others take the sources as C++.
pub fn compiles_as_cpp(folder: &Path, source: &str) {
    if installed("g++", "exported C as C++") {
        let (code, said) = run(Command::new("g++")
            .args(["-x", "c++", "-std=c++11", "-Wall", "-Wextra", "-Werror"])
            .args(["-c", source])
            .current_dir(folder));
        assert_eq!(code, Some(0), "{source}: {said}");
    }
}
