//! A `libphidget22` of C that is compiled by the test, whose devices a test sets, unplugs and plugs
//! in. `phidget22.c` says what it does.

use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

/// The library and its devices; each test has one of its own.
pub(crate) struct Fake {
    folder: TempDir,
    lines: Vec<(String, f64)>,
}

impl Fake {
    /// Without a device.
    pub(crate) fn new() -> Fake {
        let fake = Fake { folder: tempfile::tempdir().expect("a folder"), lines: Vec::new() };
        let source = Path::new(env!("CARGO_MANIFEST_DIR"))
            .ancestors()
            .map(|folder| folder.join("daemon/phidget-link/tests/fake/phidget22.c"))
            .find(|source| source.exists())
            .expect("it lies in this workspace");
        let compiled = Command::new("cc")
            .args(["-shared", "-fPIC", "-o"])
            .args([&fake.library(), &source])
            .status();
        assert!(compiled.expect("apt-get install gcc libc6-dev").success());
        fake
    }

    /// Where it lies.
    pub(crate) fn library(&self) -> PathBuf {
        self.folder.path().join("libphidget22.so.0")
    }

    fn beside(&self, ending: &str) -> PathBuf {
        self.folder.path().join(format!("libphidget22.so.0.{ending}"))
    }

    /// Sets a line of what it is told: `plugged`, `CLASS.PORT.TYPE`, `fail_every` …
    pub(crate) fn set(&mut self, key: &str, value: f64) {
        self.lines.retain(|(known, _)| known != key);
        self.lines.push((key.to_owned(), value));
        let text: String =
            self.lines.iter().map(|(key, value)| format!("{key} {value}\n")).collect();
        // Read at any time: never half of it.
        let draft = self.beside("draft");
        std::fs::write(&draft, text).expect("a file");
        std::fs::rename(draft, self.beside("state")).expect("a file");
    }

    /// How often something was done with a channel: `create`, `open`, `close`, `delete`.
    #[allow(dead_code, reason = "not every test counts")]
    pub(crate) fn count(&self, what: &str) -> usize {
        let log = std::fs::read_to_string(self.beside("log")).unwrap_or_default();
        log.lines().filter(|line| *line == what).count()
    }
}
