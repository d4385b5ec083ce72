//! Advice for a person about a plugin that does not start, derived from the way the plugin's
//! process ended and from its last output.

use std::path::Path;

/// Python modules with a package of a different name on PyPI: module, package.
const PYPI_NAMES: [(&str, &str); 4] =
    [("zenoh", "eclipse-zenoh"), ("yaml", "pyyaml"), ("serial", "pyserial"), ("smbus", "smbus2")];

/// Returns advice for a person on a start that failed for the reason `why`; `None` if there is no
/// advice for this reason.
pub(crate) fn advice(why: &str, program: &Path, package: &Path) -> Option<String> {
    if let Some(module) = missing_module(why) {
        let known = PYPI_NAMES.iter().find(|(name, _)| *name == module);
        let (name, program) = (known.map_or(module, |(_, pypi)| pypi), program.display());
        let own = package.join(".venv");
        let own = own.display();
        return Some(format!(
            "install `{name}` for {program}; or give the package a Python of its own, which is taken \
             first: {program} -m venv {own} && {own}/bin/pip install {name}"
        ));
    }
    let says = |words: &str| why.contains(words);
    // This case must come before “Permission denied”: here permission is denied to the daemon, and
    // not to the plugin.
    let advice = if says("what it keeps on disk cannot be counted") {
        "its daemon counts what it keeps: let the folders in its home be readable for its own user, \
         and their paths shorter than 4096 bytes"
    } else if says("error while loading shared libraries") {
        "it needs a library that its confinement hides: name the folder in [permissions] read"
    } else if says("exit code 126") || says("Permission denied") {
        "its confinement hides or forbids something that it uses; if its program is a shim or a \
         wrapper, name the real program in `run`; name files that it reads in [permissions] read, and \
         devices in devices"
    } else if says("exit code 127") {
        "it runs a program that is not here, or that its confinement hides: name the folder in \
         [permissions] read"
    } else if says("Operation not permitted") {
        "it makes a call that plugins may not make; sockets of the Internet need network = true in \
         [permissions]"
    } else if says("MemoryError") || says("Cannot allocate memory") || says("MiB of memory") {
        "it needs more memory: [permissions] memory"
    } else if says("did not join within") {
        "it must join the endpoint that the first line on its standard input names \
         (docs/plugins.md), within `ready-within`"
    } else {
        return None;
    };
    Some(advice.to_owned())
}

/// Returns the name of the module in a message of Python such as `ModuleNotFoundError: No module
/// named 'zenoh'`.
fn missing_module(why: &str) -> Option<&str> {
    let (_, rest) = why.split_once("No module named ")?;
    let name = rest.trim_start_matches(['\'', '"']).split(['\'', '"', '.']).next()?;
    let is_name = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
    is_name.then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advice_matches_the_reason_of_the_failure() {
        for (why, expected) in [
            (
                "it ended by itself with exit code 1: ModuleNotFoundError: No module named 'zenoh'",
                "/usr/bin/python3 -m venv /p/.venv && /p/.venv/bin/pip install eclipse-zenoh",
            ),
            (
                "it ended by itself with exit code 1: No module named 'numpy.core'",
                "install `numpy`",
            ),
            (
                "it ended by itself with exit code 126: Permission denied",
                "name the real program in `run`",
            ),
            (
                "what it keeps on disk cannot be counted: its folder /d cannot be read: Permission \
                 denied",
                "readable for its own user",
            ),
            ("error while loading shared libraries: libx.so: cannot open", "a library"),
            ("`a` did not join within 20s", "the first line on its standard input"),
            ("PermissionError: [Errno 1] Operation not permitted", "network = true"),
        ] {
            let advice = advice(why, Path::new("/usr/bin/python3"), Path::new("/p"));
            assert!(advice.as_deref().is_some_and(|said| said.contains(expected)), "{advice:?}");
        }
        assert_eq!(advice("it was ended by signal 11", Path::new("/x"), Path::new("/p")), None);
    }
}
