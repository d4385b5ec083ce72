//! The tables of the documented commands: which are not run, with the reason; how some end; and what
//! is done before a document's commands.

use super::Ending;

/// Commands that are not run: the document or `*` for all, a part of the command, and the reason.
pub(super) const LEFT_OUT: &[(&str, &str, &str)] = &[
    ("*", "sudo ", "changes the machine"),
    ("*", "pip install", "installs from a package registry"),
    ("*", "python3 -m venv", "prepares an installation from a package registry"),
    ("*", "cargo ", "compiles for minutes; .ci/run runs the two of README.md"),
    ("*", "curl ", "asks a page that the ecosystem file of the document serves"),
    ("*", "plugin check", "needs Python with eclipse-zenoh; tests/languages.rs runs it"),
    ("README.md", "plugin add", "needs Python with eclipse-zenoh; tests/plugins.rs runs it"),
    ("docs/plugins.md", "plugin add", "needs Python with eclipse-zenoh; tests/plugins.rs runs it"),
    ("README.md", "althing view  ", "needs a terminal; tests/views.rs opens one"),
    ("docs/view.md", "the overview", "needs a terminal; tests/views.rs opens one"),
    ("docs/view.md", "view goal ", "needs a terminal; tests/views.rs opens one"),
    ("docs/cameras.md", "(recorded office1)", "needs a camera"),
    ("docs/devices.md", "althing goal ", "needs the devices of an MQTT broker"),
    ("docs/first-steps.md", "althing ", "tests/first_steps.rs plays these steps"),
    (
        "docs/goals.md",
        "temperatures --",
        "waits for hours; tests/it/due.rs has times some seconds ahead",
    ),
    ("docs/goals.md", "--at 2026", "waits for days; tests/it/due.rs has times some seconds ahead"),
    ("docs/history.md", "'#8123'", "the number of an event is another one in each ecosystem"),
    ("docs/knowledge.md", "althing set ", "is about the rooms and lamps of the document"),
    ("docs/packages.md", "openssl ", "needs the files of a release"),
    ("docs/packages.md", "sha256sum ", "needs the files of a release"),
    ("docs/packages.md", "deploy/release ", "compiles for minutes"),
    (
        "docs/packages.md",
        "restore office.tar.gz --check",
        "needs a backup; tests/backups.rs makes one",
    ),
    ("docs/people.md", "people add anna", "asks for a password at a terminal"),
    ("docs/people.md", "scp ", "needs another machine"),
    ("docs/people.md", "ssh ", "needs another machine"),
    ("docs/planner.md", "benches/", "needs a folder of competition tasks"),
    ("docs/robots.md", "althing ", "needs a robot with ROS 2; tests/robots.rs stands in for one"),
    ("docs/screens.md", "althing ", "needs a screen; tests/screens.rs stands in for one"),
    ("docs/stops.md", "9f3a01c2", "the name of a stop is another one each time"),
    ("docs/web.md", "chromium ", "needs a display"),
    (
        "docs/words.md",
        "althing goal ",
        "is about other buildings, too; tests/words.rs asks in words",
    ),
    ("docs/web.md", "people add-screen", "names a robot of the document's building"),
    ("docs/web.md", "cert page", "needs the certificates of the document's building"),
];

/// How commands end that do not end at once with the exit code 0, by a part of the command.
pub(super) const ENDINGS: &[(&str, Ending)] = &[
    ("althing up ", Ending::Daemon),
    ("althing watch", Ending::Said("listening to ")),
    ("--maintain", Ending::Said("holds")),
    // The robot may have moved on by itself.
    ("althing act ", Ending::Code(&[0, 1])),
    // What is wrong with the machine that runs the tests is not known.
    ("althing doctor", Ending::Code(&[0, 1])),
    // Nothing may have happened at that time of today.
    ("--since 09:30", Ending::Code(&[0, 1])),
];

/// Commands that are run before those of a document, so that its commands find what they are about.
pub(super) const PREPARATIONS: &[(&str, &str)] = &[
    ("docs/history.md", "althing goal temperatures"),
    ("docs/metrics.md", "althing cert authority althing.toml"),
];
