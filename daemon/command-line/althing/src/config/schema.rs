//! The schema of ecosystem files: every key with its name, the shape of its value, and its purpose.
//!
//! For a new key, add one line here, one field in `raw` and, if the key may be left out, one line
//! in `defaults.toml`. The texts of error messages and suggestions are made from this table.

/// One key of a table in the ecosystem file.
#[derive(Debug)]
pub(super) struct SchemaKey {
    pub(super) name: &'static str,
    pub(super) shape: Shape,
    /// The purpose of the key, in a few words.
    pub(super) about: &'static str,
}

/// The shape that the value of a key must have.
#[derive(Debug)]
pub(super) enum Shape {
    /// A text in quotes.
    Text,
    /// The path of a file or folder, in quotes; not empty.
    Path,
    /// A text in quotes, or a list of such texts.
    Texts,
    /// One of these words, in quotes.
    Choice(&'static [&'static str]),
    /// A duration in quotes, such as `"500ms"`.
    Duration,
    /// A whole number greater than 0.
    Count,
    /// `true` or `false`.
    Flag,
    /// A number from `min` to `max`.
    Number { min: f64, max: f64 },
    /// A list in brackets, with elements of this shape.
    List(&'static Shape),
    /// A table that may have these keys and no others.
    Table(&'static [SchemaKey]),
    /// A table with arbitrary keys, and values of this shape.
    Each(&'static Shape),
    /// A table with these keys, or a single text. A single text is the value of the named key.
    Brief(&'static str, &'static [SchemaKey]),
    /// A table with arbitrary contents, which is passed on as it is.
    Free,
    /// Any value, which is passed on as it is and checked by `interpret`.
    Any,
}

const fn key(name: &'static str, shape: Shape, about: &'static str) -> SchemaKey {
    SchemaKey { name, shape, about }
}

/// The shape of a whole ecosystem file.
pub(super) static FILE: Shape = Shape::Table(&[
    key("ecosystem", Shape::Table(ECOSYSTEM), "its name, files and daemons"),
    key("rooms", Shape::Each(&Shape::Any), "the places of the building, by name"),
    key("doors", Shape::Each(&Shape::Any), "the ways between places, by the place they lead from"),
    key("zenoh", Shape::Free, "handed to Zenoh as it is"),
    key("agent", Shape::List(&Shape::Table(AGENT)), "the agents, one [[agent]] each"),
    key(
        "interface",
        Shape::List(&Shape::Table(INTERFACE)),
        "other ecosystems, one [[interface]] each",
    ),
    key(
        "goals",
        Shape::Each(&Shape::Brief("goal", GOAL)),
        "goals with a name, in words or in PDDL",
    ),
    key("timing", Shape::Table(TIMING), "periods and deadlines"),
    key("limits", Shape::Table(LIMITS), "lengths of queues"),
    key("security", Shape::Table(SECURITY), "links by TLS, and signed messages"),
    key("rights", Shape::Table(RIGHTS), "rights, in a secured ecosystem"),
    key("people", Shape::Table(PEOPLE), "people that may sign in at a page"),
    key(
        "safeguards",
        Shape::Each(&Shape::Each(&Shape::Table(SAFEGUARD))),
        "actions that a person must allow, or that are limited, by agent and action",
    ),
    key(
        "hardware-stops",
        Shape::Each(&Shape::Table(HARDWARE_STOP)),
        "sensors that stop actuators while they are pressed, by the sensor's agent",
    ),
    key("plugins", Shape::Table(PLUGINS), "plugins that run as processes"),
    key("metrics", Shape::Table(METRICS), "figures for operators, by HTTP"),
    key("web", Shape::Table(WEB), "a page for browsers"),
    key("building", Shape::Table(BUILDING), "the simulated building"),
    key("words", Shape::Each(&Shape::Free), "phrases of its own, by language: [words.en]"),
]);

const ECOSYSTEM: &[SchemaKey] = &[
    key("name", Shape::Text, "its name, such as \"smart-office\""),
    key("domain", Shape::Path, "the file of the shared ontology, such as \"domain.pddl\""),
    key("problem", Shape::Path, "the file of the map, such as \"map.pddl\""),
    key("vocabulary", Shape::Path, "the file with words that the standard ontology lacks"),
    key("reasoning", Shape::Texts, "the daemons that plan, if no agent of the file does"),
    key("mode", Shape::Choice(&["centralized", "decentralized"]), "the planning mode"),
    key("privacy", Shape::Choice(&["ecosystem", "agents"]), "from whom `:private` parts are kept"),
    key("daemons", Shape::List(&Shape::Text), "daemons that host no agent yet"),
    key("time-zone", Shape::Text, "the time zone of its goals, such as \"Europe/Berlin\""),
];

const GOAL: &[SchemaKey] = &[
    key("goal", Shape::Text, "the goal, in words or in PDDL"),
    key("keep", Shape::Choice(&["achieve", "maintain"]), "whether it is reached once, or kept"),
    key("priority", PRIORITY, "greater goes first"),
    key("partition", Shape::Choice(&["pursue", "wait"]), "what happens to it during a partition"),
    key("ask", Shape::Choice(&["always"]), "whether it is asked for by itself, and kept"),
    key("at", Shape::Text, "when it is asked for once, such as \"2026-12-01T08:00\""),
    key("every", Shape::Text, "when it is asked for again and again, such as \"day 08:00\""),
    key("on", Shape::Text, "the days of the week, such as \"workdays\""),
    key("between", Shape::Text, "the hours of the day, such as \"08:00-18:00\""),
    key("by", Shape::Text, "when it should be reached, such as \"09:00\" or \"30min\""),
    key("for", Shape::Text, "how long it is pursued each time, such as \"2h\""),
    key("until", Shape::Text, "when all of this ends, such as \"2026-12-24\""),
];

/// The shape of a goal's priority: a number that fits into an `i32` and that people can still
/// compare.
const PRIORITY: Shape = Shape::Number { min: -1_000_000.0, max: 1_000_000.0 };

const SAFEGUARD: &[SchemaKey] = &[
    key("confirm", Shape::Flag, "whether a person must allow the action each time"),
    key("patience", Shape::Duration, "how long people may take to allow it"),
    key("at-most", Shape::Count, "how often it may begin in the time `per`"),
    key("per", Shape::Duration, "the time that `at-most` counts in"),
];

const HARDWARE_STOP: &[SchemaKey] = &[
    key("stops", Shape::Texts, "the agents and places that it stops; without it, everything"),
    key("pressed", Shape::Text, "when it is pressed: \"open\", \"closed\", or a fact"),
    key("release", Shape::Choice(&["person", "button"]), "whether a person releases the stop"),
    key("fail-safe", Shape::Flag, "whether a silent one counts as pressed"),
];

const AGENT: &[SchemaKey] = &[
    key("name", Shape::Text, "its name, such as \"thermometer-office2\""),
    key("plugin", Shape::Text, "its kind, such as \"temperature-sensor\""),
    key("package", Shape::Text, "the package with the program that brings it"),
    key("daemon", Shape::Texts, "which machine hosts it; of several, one at a time"),
    key("driver", Shape::Text, "what it acts through, such as \"simulated\""),
    key("config", Shape::Free, "handed to the plugin as it is"),
    key("actions", Shape::Texts, "the actions it may offer, where that is limited"),
];

/// The keys of an interface. A word passes the interface only if one of these tables contains it;
/// that holds in both directions.
const INTERFACE: &[SchemaKey] = &[
    key("ecosystem", Shape::Path, "the other ecosystem's file, such as \"house.toml\""),
    key("daemon", Shape::Text, "our daemon that joins both ecosystems"),
    key("as", Shape::Text, "its name in the other ecosystem"),
    key("rate", Shape::Number { min: 0.01, max: 10_000.0 }, "messages a second, each way"),
    key("types", WORDS, "ours = theirs"),
    key("predicates", WORDS, "ours = theirs"),
    key("functions", WORDS, "ours = theirs"),
    key("objects", WORDS, "ours = theirs"),
    key("import", Shape::List(&Shape::Table(RULE)), "what the other ecosystem lends this one"),
    key("export", Shape::List(&Shape::Table(RULE)), "what this ecosystem lends the other"),
];

const WORDS: Shape = Shape::Each(&Shape::Text);

const RULE: &[SchemaKey] = &[
    key("agent", Shape::Text, "the agent, by its own name"),
    key("as", Shape::Text, "its name on the other side"),
    key("performatives", Shape::List(&Shape::Choice(PASSING)), "what passes to and from it"),
    key("actions", WORDS, "ours = theirs"),
    key("costs", Shape::Each(&Shape::Number { min: 0.0, max: 1e9 }), "what an action costs plans"),
    key("goals", Shape::List(&Shape::Text), "our predicates that goals may be made of"),
];

/// The names of the performatives that may pass an interface.
const PASSING: &[&str] = &{
    let mut names = [""; interfacing::PASSABLE_PERFORMATIVES.len()];
    let mut at = 0;
    while at < names.len() {
        names[at] = interfacing::PASSABLE_PERFORMATIVES[at].as_str();
        at += 1;
    }
    names
};

const TIMING: &[SchemaKey] = &[
    key("heartbeat-period", Shape::Duration, "how often an actuator says that it works"),
    key("heartbeat-lease", Shape::Duration, "how long it may be silent"),
    key("grace", Shape::Duration, "how long a plan bears the absence of an agent"),
    key("removal", Shape::Duration, "how long its facts are believed after it left"),
    key("retry-first", Shape::Duration, "each of the first three waits for a receipt"),
    key("retry-max", Shape::Duration, "longest wait for a receipt"),
    key("proposals-deadline", Shape::Duration, "how long bidders have to propose"),
    key("planning-deadline", Shape::Duration, "how long a planner may search"),
    key("answer-deadline", Shape::Duration, "how long a question may take"),
];

const LIMITS: &[SchemaKey] = &[
    key("mailbox-messages-max", Shape::Count, "messages a mailbox holds"),
    key("outbox-messages-max", Shape::Count, "commitments without a receipt"),
];

const SECURITY: &[SchemaKey] = &[
    key("folder", Shape::Path, "where keys and certificates are"),
    key("warn-days", Shape::Count, "how long before its end a certificate is announced"),
    key("messages-per-second-max", Shape::Count, "messages that one daemon may send"),
];

const RIGHTS: &[SchemaKey] = &[
    key("guests", Shape::Texts, "daemons that people may use; \"*\" is all"),
    key("newcomers", Shape::Texts, "daemons that may bring agents which the file does not name"),
    key("goals", Shape::Texts, "agents that may ask for goals; \"guests\", \"*\""),
    key("changes", Shape::Texts, "agents that may change the known facts; \"guests\", \"*\""),
    key("history", Shape::Texts, "agents that may read what happened; \"guests\", \"*\""),
    key("private", Shape::Texts, "agents that may read what happened to private facts; \"guests\""),
];

const PEOPLE: &[SchemaKey] =
    &[key("file", Shape::Path, "where people are, such as \"people.toml\"")];

const PLUGINS: &[SchemaKey] = &[
    key("folder", Shape::Path, "where packages are, such as \"plugins\""),
    key(
        "admit",
        Shape::Choice(&["all", "ask", "listed"]),
        "whether agents that the file does not name join",
    ),
    key(
        "confinement",
        Shape::Choice(&["available", "require"]),
        "whether plugins run where the kernel cannot confine them fully",
    ),
];

const METRICS: &[SchemaKey] =
    &[key("listen", Shape::Text, "address and port, such as \"127.0.0.1:9464\"")];

const WEB: &[SchemaKey] = &[
    key("listen", Shape::Text, "the address, such as \"127.0.0.1:8650\""),
    key("daemons", Shape::Texts, "the daemons that serve it; without it, all"),
    key("names", Shape::Texts, "host names by which browsers reach it, such as \"office.lan\""),
    key("certificate", Shape::Path, "the file of its certificate, instead of `althing cert page`"),
    key("key", Shape::Path, "the file of the certificate's key"),
];

const BUILDING: &[SchemaKey] = &[
    key("temperatures", Shape::Each(&CELSIUS), "the true temperature of each place, in °C"),
    key("conditions", Shape::Each(&CONDITIONS), "what else is true of each place, such as its co2"),
    key("time-scale", Shape::Number { min: 0.0, max: 1_000.0 }, "1.0 is real time"),
    key("socket", Shape::Path, "where several processes share the building"),
];

/// The shape of a temperature in the simulated building, in °C: from absolute zero to the heat of a
/// furnace.
const CELSIUS: Shape = Shape::Number { min: -273.15, max: 1_000.0 };

/// The shape of a place's other conditions, by quantity; the building itself checks the bounds of
/// each quantity.
const CONDITIONS: Shape = Shape::Each(&Shape::Number { min: 0.0, max: 1_000_000.0 });

// === impl Shape ===

impl Shape {
    /// Describes the correct value in words that can follow “must be”.
    pub(super) fn expected(&self) -> String {
        match self {
            Shape::Text => "a text in quotes".to_owned(),
            Shape::Path => "a path in quotes, which is not empty".to_owned(),
            Shape::Texts => "a text in quotes, or a list of them in [ ]".to_owned(),
            Shape::Brief(key, _) => format!("a text in quotes, or a table with `{key}`"),
            Shape::Choice(words) => {
                let quoted: Vec<String> = words.iter().map(|word| format!("\"{word}\"")).collect();
                quoted.join(" or ")
            }
            Shape::Duration => "a duration, such as \"500ms\", \"2s\" or \"1min\"".to_owned(),
            Shape::Count => "a whole number above 0".to_owned(),
            Shape::Flag => "true or false".to_owned(),
            Shape::Number { min, max } => format!("a number from {min} to {max}"),
            Shape::List(element) => format!("a list in [ ], each {}", element.expected()),
            Shape::Table(_) | Shape::Each(_) | Shape::Free => "a table".to_owned(),
            Shape::Any => "a value".to_owned(),
        }
    }

    /// Describes the correct value in the notation of the rule that messages show, such as `"TEXT"
    /// | ["TEXT", …]`.
    pub(super) fn notation(&self) -> String {
        match self {
            Shape::Text => "\"TEXT\"".to_owned(),
            Shape::Path => "\"PATH\"".to_owned(),
            Shape::Texts => "\"TEXT\" | [\"TEXT\", …]".to_owned(),
            Shape::Choice(words) => {
                let quoted: Vec<String> = words.iter().map(|word| format!("\"{word}\"")).collect();
                quoted.join(" | ")
            }
            Shape::Brief(key, _) => format!("\"TEXT\" | {{ {key} = \"TEXT\", … }}"),
            Shape::Duration => "\"NUMBER(ms|s|min|h)\"".to_owned(),
            Shape::Count => "INTEGER".to_owned(),
            Shape::Flag => "true|false".to_owned(),
            Shape::Number { .. } => "NUMBER".to_owned(),
            Shape::List(element) => format!("[{}, …]", element.notation()),
            Shape::Table(_) | Shape::Each(_) | Shape::Free => "{ KEY = VALUE, … }".to_owned(),
            Shape::Any => "VALUE".to_owned(),
        }
    }
}
