//! Checks which crate depends on which (ARCHITECTURE.md, “Layers”), according to `cargo metadata`.

use std::process::Command;

use serde_json::Value;

use crate::{none, root};

/// The layers, lowest first. A crate depends only on lower layers, so two crates of one layer never
/// depend on each other.
const LAYERS: &[&[&str]] = &[
    &["acl", "pddl"],
    &[
        "accounts",
        "backups",
        "building",
        "capability",
        "cast-link",
        "conversation",
        "credentials",
        "ecosystem-edit",
        "goal-lifecycle",
        "goal-schedule",
        "gpio-lines",
        "linux-sensors",
        "machine",
        "metrics-endpoint",
        "mqtt-link",
        "ontology",
        "onvif-link",
        "phidget-link",
        "phrases",
        "planner",
        "programs",
        "ros-messages",
        "screen-link",
        "seccomp-notify",
        "substrate",
    ],
    // `engines` depends on `planner` for its validator: every engine's plan is validated.
    // `plan-execution` depends on `planner` for the order of steps and the effects of each.
    // `skeleton` depends on `planner`, with which it plans over projections.
    &[
        "agent",
        "engines",
        "live-view",
        "plan-execution",
        "ros2-link",
        "simulated-nav2",
        "skeleton",
        "substrate-zenoh",
        "terminal",
    ],
    &["actuator", "althing-plan", "terminal-view", "web-page"],
    &["mobile-base"],
    &[
        "cleaning-robot",
        "command",
        "arm",
        "courier",
        "mover",
        "domain-maintainer",
        "door",
        "doorkeeper",
        "factored-agent",
        "history",
        "ir-temperature-sensor",
        "journal",
        "keyboard",
        "lift",
        "mqtt",
        "notifier",
        "plan-executor",
        "plan-requester",
        "planning-agent",
        "ptz-camera",
        "robot-watchdog",
        "ros2",
        "screen",
        "sensor",
        "switch",
        "tag-reader",
        "traces",
        "turtlebot",
        "video-robot",
    ],
    // Above the plugins: an interface contains a Keyboard; a plugin process contains any plugin.
    &["interfacing", "plugin-host", "plugin-process"],
    &["althing", "laboratory", "tests"],
];

/// Index of the plugins' layer.
const PLUGINS: usize = 5;

/// Crates of this workspace that every plugin may depend on.
const PLUGINS_KNOW: &[&str] = &["acl", "actuator", "agent", "pddl"];

/// Further crates that single plugins may depend on, with reasons.
const EXCEPTIONS: &[Exception] = &[
    exception("domain-maintainer", "capability", "it is that state machine, given a mailbox"),
    exception("factored-agent", "planner", "plans its part, and over projections"),
    exception("factored-agent", "skeleton", "it is a partner with a mailbox"),
    exception("factored-agent", "substrate", "its tests run it on a network in memory"),
    exception("plan-executor", "plan-execution", "it is that state machine, given a mailbox"),
    exception("keyboard", "credentials", "it seals what people answer"),
    exception("history", "credentials", "it seals what is private to those that may read it"),
    exception("domain-maintainer", "planner", "tells what axioms derive of the state"),
    exception("plan-requester", "goal-lifecycle", "it is that state machine, given a mailbox"),
    exception("plan-requester", "goal-schedule", "it asks itself for goals when they are due"),
    exception("plan-requester", "planner", "validates proposals, takes goals apart"),
    exception("planning-agent", "planner", "it is that planner, given a mailbox"),
    exception("cleaning-robot", "building", "its simulated driver sweeps there"),
    exception("cleaning-robot", "mobile-base", "it is a mobile base with a broom"),
    exception("arm", "building", "its simulated driver moves there"),
    exception("courier", "building", "its simulated driver carries parcels there"),
    exception("courier", "mobile-base", "it is a mobile base with hands"),
    exception("mover", "building", "its simulated driver carries tables there"),
    exception("mover", "mobile-base", "it is a mobile base that carries tables with another"),
    exception("door", "building", "its simulated driver opens there"),
    exception("lift", "building", "its simulated driver goes there"),
    exception("tag-reader", "building", "its simulated driver reads there"),
    exception("ir-temperature-sensor", "building", "its simulated driver measures there"),
    exception("notifier", "substrate", "its tests run it on a network in memory"),
    exception("ptz-camera", "building", "its simulated driver looks there"),
    exception("ptz-camera", "onvif-link", "its ONVIF driver turns and looks there"),
    exception("ptz-camera", "programs", "its Motion and its ffmpeg run there"),
    exception("robot-watchdog", "ros2-link", "it stops the robot there"),
    exception("ros2", "ros-messages", "its entries name the types of ROS"),
    exception("ros2", "ros2-link", "it asks the nodes of ROS there"),
    exception("ros2", "simulated-nav2", "its tests serve actions there"),
    exception("screen", "building", "its simulated driver shows there"),
    exception("screen", "cast-link", "its Chromecast is told there what to show"),
    exception("screen", "programs", "its browser and its mpv run there"),
    exception("screen", "screen-link", "its browser and its mpv are told there what to show"),
    exception("sensor", "building", "its simulated driver measures there"),
    exception("sensor", "gpio-lines", "its GPIO driver watches there"),
    exception("sensor", "linux-sensors", "its Linux driver measures there"),
    exception("sensor", "programs", "its command driver runs there"),
    exception("sensor", "mqtt-link", "its MQTT driver hears there"),
    exception("sensor", "phidget-link", "its Phidget driver measures there"),
    exception("mqtt", "mqtt-link", "it hears and speaks there"),
    exception("command", "programs", "it is any program"),
    exception("switch", "gpio-lines", "its GPIO driver drives there"),
    exception("switch", "programs", "its command driver runs there"),
    exception("turtlebot", "mobile-base", "it is a mobile base that carries sensors"),
    exception("video-robot", "building", "its simulated driver shows there"),
    exception("video-robot", "mobile-base", "it is a mobile base with a screen"),
];

/// Crates that a benchmark may depend on in spite of its layer, with reasons. Benchmarks are not
/// shipped.
const BESIDE: &[Exception] = &[exception(
    "substrate-zenoh",
    "agent",
    "a benchmark holds agents against plain Zenoh, which nobody else may name",
)];

/// Crates that the pure crates must not depend on: runtimes, logs, clocks, randomness.
const IMPURE: &[&str] = &["tokio", "tokio-util", "tracing", "log", "rand", "chrono", "zenoh"];

/// The pure crates: they only return values.
pub(crate) const PURE: &[&str] = &[
    "acl",
    "pddl",
    "conversation",
    "capability",
    "goal-lifecycle",
    "live-view",
    "phrases",
    "ontology",
    "planner",
    "plan-execution",
    "ros-messages",
    "terminal-view",
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Exception {
    of: &'static str,
    knows: &'static str,
    reason: &'static str,
}

const fn exception(of: &'static str, knows: &'static str, reason: &'static str) -> Exception {
    Exception { of, knows, reason }
}

impl Exception {
    fn allows(&self, edge: &Edge) -> bool {
        edge.of == self.of && edge.on == self.knows
    }
}

/// Returns the exceptions that are no longer needed.
fn unused(edges: &[Edge], exceptions: &[Exception]) -> Vec<String> {
    exceptions
        .iter()
        .filter(|known| !edges.iter().any(|edge| known.allows(edge)))
        .map(|Exception { of, knows, reason }| {
            format!("`{of}` does not depend on `{knows}` any more: drop “{reason}”")
        })
        .collect()
}

/// One dependency of a crate of this workspace.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Edge {
    of: String,
    on: String,
    /// Whether the dependency is a crate of this workspace.
    is_inside: bool,
    /// Whether it is not a dev-dependency.
    is_shipped: bool,
}

/// Returns the dependencies in the output of `cargo metadata`.
fn edges(metadata: &Value) -> Vec<Edge> {
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let mut edges = Vec::new();
    for package in list(&metadata["packages"]) {
        for dependency in list(&package["dependencies"]) {
            edges.push(Edge {
                of: text(&package["name"]),
                on: text(&dependency["name"]),
                is_inside: dependency["path"].is_string(),
                is_shipped: dependency["kind"] != "dev",
            });
        }
    }
    edges
}

/// Returns the output of `cargo metadata` for this workspace.
fn metadata() -> Value {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args(["metadata", "--no-deps", "--format-version", "1", "--offline"])
        .current_dir(root())
        .output()
        .expect("run `cargo metadata`");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("`cargo metadata` prints JSON")
}

fn layer(name: &str) -> Option<usize> {
    LAYERS.iter().position(|layer| layer.contains(&name))
}

// === rules: from edges to complaints ===

fn not_downwards(edges: &[Edge], beside: &[Exception]) -> Vec<String> {
    edges
        .iter()
        .filter(|edge| edge.is_inside)
        .filter(|edge| edge.is_shipped || !beside.iter().any(|known| known.allows(edge)))
        .filter_map(|Edge { of, on, .. }| match (layer(of), layer(on)) {
            (Some(of_layer), Some(on_layer)) if on_layer < of_layer => None,
            (Some(of_layer), Some(on_layer)) => {
                Some(format!("`{of}` (L{of_layer}) may not depend on `{on}` (L{on_layer})"))
            }
            _ => Some(format!("`{of}` or `{on}` has no layer: place it in LAYERS first")),
        })
        .collect()
}

/// Returns forbidden dependencies of plugins, and exceptions that are no longer needed.
fn too_curious(edges: &[Edge], exceptions: &[Exception]) -> Vec<String> {
    let curious = edges
        .iter()
        .filter(|edge| edge.is_inside && layer(&edge.of) == Some(PLUGINS))
        .filter(|edge| !PLUGINS_KNOW.contains(&edge.on.as_str()))
        .filter(|edge| !exceptions.iter().any(|known| known.allows(edge)))
        .map(|Edge { of, on, .. }| format!("the plugin `{of}` may not depend on `{on}`"));
    curious.chain(unused(edges, exceptions)).collect()
}

/// Crates that name `zenoh`: the substrate, and a device bus of its own. A robot with ROS 2 is
/// reached over Zenoh, as an MQTT broker is over MQTT; no message of an agent travels there.
const ON_ZENOH: &[&str] = &["substrate-zenoh", "ros2-link", "simulated-nav2"];

fn names_zenoh(edges: &[Edge]) -> Vec<String> {
    edges
        .iter()
        .filter(|edge| edge.on.starts_with("zenoh") && !ON_ZENOH.contains(&edge.of.as_str()))
        .map(|Edge { of, on, .. }| format!("`{of}` may not depend on `{on}`"))
        .collect()
}

fn impure(edges: &[Edge]) -> Vec<String> {
    edges
        .iter()
        .filter(|edge| edge.is_shipped && PURE.contains(&edge.of.as_str()))
        .filter(|edge| IMPURE.contains(&edge.on.as_str()))
        .map(|Edge { of, on, .. }| format!("the pure crate `{of}` may not depend on `{on}`"))
        .collect()
}

// === the workspace ===

#[test]
fn dependencies_point_down() {
    let edges = edges(&metadata());
    let upwards = not_downwards(&edges, BESIDE);
    let complaints = [upwards, unused(&edges, BESIDE)].concat();
    none(&complaints, "dependencies point strictly down");
}

#[test]
fn every_crate_has_a_layer() {
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("packages");
    let names: Vec<_> = packages.iter().filter_map(|package| package["name"].as_str()).collect();
    let homeless = names.iter().filter(|name| layer(name).is_none());
    let gone = LAYERS.iter().copied().flatten().filter(|name| !names.contains(name));
    let homeless = homeless.map(|name| format!("`{name}` has no layer: place it in LAYERS"));
    let gone = gone.map(|name| format!("`{name}` is no crate any more: drop it from LAYERS"));
    none(&homeless.chain(gone).collect::<Vec<_>>(), "every crate has a layer");
}

#[test]
fn plugins_depend_on_no_substrate_and_no_other_plugin() {
    none(&too_curious(&edges(&metadata()), EXCEPTIONS), "plugins see `agent`");
}

#[test]
fn only_the_substrate_and_the_bus_of_robots_name_zenoh() {
    let edges = edges(&metadata());
    none(&names_zenoh(&edges), "only the substrate and the bus of robots name `zenoh`");
    for of in ON_ZENOH {
        let is_named = edges.iter().any(|edge| edge.on == "zenoh" && edge.of == *of);
        assert!(is_named, "`{of}` is not on Zenoh any more: drop it from ON_ZENOH");
    }
}

/// If a patch no longer fits, cargo only warns and takes the published crate.
#[test]
fn zenoh_is_built_with_our_crate_of_tls_links() {
    let lock = std::fs::read_to_string(root().join("Cargo.lock")).expect("it is committed");
    let packages: Vec<_> = lock.split("[[package]]").collect();
    let ours = packages.iter().find(|each| each.contains("name = \"zenoh-link-tls\""));
    let ours = ours.expect("Zenoh has TLS links");
    assert!(
        !ours.contains("source = "),
        "daemon/transport/substrate-zenoh/vendor is not used: see its README"
    );
}

#[test]
fn pure_crates_have_no_runtime_at_hand() {
    none(&impure(&edges(&metadata())), "the pure crates return values");
}

// === the rules can fail ===

fn inside(of: &str, on: &str) -> Edge {
    Edge { of: of.to_owned(), on: on.to_owned(), is_inside: true, is_shipped: true }
}

#[test]
fn metadata_is_read() {
    let metadata = serde_json::json!({ "packages": [{ "name": "a", "dependencies": [
        { "name": "b", "path": "/b", "kind": null },
        { "name": "c", "kind": "dev" },
    ]}]});
    let outside = Edge { is_inside: false, is_shipped: false, ..inside("a", "c") };
    assert_eq!(edges(&metadata), [inside("a", "b"), outside]);
}

#[test]
fn dependencies_up_or_sideways_are_found() {
    for (of, on, is_fine) in [
        ("agent", "capability", true),
        ("capability", "agent", false),
        ("planner", "capability", false),
        ("agent", "nobody", false),
    ] {
        assert_eq!(not_downwards(&[inside(of, on)], &[]).is_empty(), is_fine, "{of} → {on}");
    }
    let beside = [exception("planner", "capability", "why")];
    let benchmark = Edge { is_shipped: false, ..inside("planner", "capability") };
    assert!(not_downwards(&[benchmark], &beside).is_empty());
    assert!(!not_downwards(&[inside("planner", "capability")], &beside).is_empty(), "shipped");
}

#[test]
fn forbidden_dependencies_of_plugins_and_unused_exceptions_are_found() {
    let known = [exception("turtlebot", "mobile-base", "why")];
    let used = inside("turtlebot", "mobile-base");
    let check = |edge, exceptions: &[Exception], complaints| {
        assert_eq!(too_curious(&[edge], exceptions).len(), complaints, "{exceptions:?}");
    };
    check(used.clone(), &known, 0);
    check(used, &[], 1);
    check(inside("turtlebot", "substrate"), &[], 1);
    check(inside("keyboard", "plan-requester"), &[], 1);
    check(inside("turtlebot", "agent"), &known, 1);
}

#[test]
fn zenoh_and_runtimes_are_found() {
    let outside = |of, on| Edge { is_inside: false, ..inside(of, on) };
    assert_eq!(names_zenoh(&[outside("agent", "zenoh-ext")]).len(), 1);
    assert_eq!(names_zenoh(&[outside("substrate-zenoh", "zenoh")]).len(), 0);
    assert_eq!(impure(&[outside("planner", "tokio")]).len(), 1);
    assert_eq!(impure(&[Edge { is_shipped: false, ..outside("planner", "tokio") }]).len(), 0);
}
