//! A fake `libphidget22` in C that the test compiles. A test sets, unplugs and plugs in the devices
//! of the library. `phidget22.c` describes the behaviour of the library.

use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

/// A fake library and its devices; each test has a library of its own.
pub(crate) struct Fake {
    folder: TempDir,
    lines: Vec<(String, f64)>,
}

impl Fake {
    /// Compiles a fake library, which has no devices yet.
    pub(crate) fn new() -> Fake {
        let fake = Fake { folder: tempfile::tempdir().expect("a folder"), lines: Vec::new() };
        let source = Path::new(env!("CARGO_MANIFEST_DIR"))
            .ancestors()
            .map(|folder| folder.join("daemon/devices/phidget-link/tests/fake/phidget22.c"))
            .find(|source| source.exists())
            .expect("it lies in this workspace");
        let compiled = Command::new("cc")
            .args(["-shared", "-fPIC", "-o"])
            .args([&fake.library(), &source])
            .status();
        assert!(compiled.expect("apt-get install gcc libc6-dev").success());
        fake
    }

    /// Returns the path of the fake library.
    pub(crate) fn library(&self) -> PathBuf {
        self.folder.path().join("libphidget22.so.0")
    }

    fn beside(&self, ending: &str) -> PathBuf {
        self.folder.path().join(format!("libphidget22.so.0.{ending}"))
    }

    /// Sets a line of the file that the fake library reads: `plugged`, `CLASS.PORT.TYPE`,
    /// `fail_every` …
    pub(crate) fn set(&mut self, key: &str, value: f64) {
        self.lines.retain(|(known, _)| known != key);
        self.lines.push((key.to_owned(), value));
        let text: String =
            self.lines.iter().map(|(key, value)| format!("{key} {value}\n")).collect();
        // The library may read the file at any time, so the file is replaced by a rename.
        let draft = self.beside("draft");
        std::fs::write(&draft, text).expect("a file");
        std::fs::rename(draft, self.beside("state")).expect("a file");
    }

    /// Returns the number of calls of one of the functions for channels of the fake library:
    /// `create`, `open`, `close`, `delete`.
    #[allow(dead_code, reason = "not every test counts")]
    pub(crate) fn count(&self, what: &str) -> usize {
        let log = std::fs::read_to_string(self.beside("log")).unwrap_or_default();
        log.lines().filter(|line| *line == what).count()
    }
}
