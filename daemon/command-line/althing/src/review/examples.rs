//! Examples of the values of keys in the `config` of an entry, which say what would be right.

use pddl::Types;
use serde_json::Value;

use crate::config::{AgentEntry, Ecosystem};

/// Returns an example of the value of a key in the table at `path` of the `config` of `entry`, as TOML.
/// The example contains names of this ecosystem where possible.
pub(super) fn example(
    key: &str,
    path: &str,
    entry: &AgentEntry,
    ecosystem: &Ecosystem,
) -> Option<String> {
    let quote = |name: &str| format!("\"{name}\"");
    let place = || place(ecosystem, "location").unwrap_or_else(|| "hall".to_owned());
    Some(match key {
        "location" => quote(&self::place(ecosystem, "room").unwrap_or_else(place)),
        "start" | "dock" | "shows" | "near" => quote(&place()),
        "mounted-on" => {
            let robots = ecosystem.agents.iter().filter(|each| each.config.get("start").is_some());
            quote(robots.map(|each| each.name.as_str()).next().unwrap_or("robot-1"))
        }
        "presets" => format!("{{ door = {{ shows = \"{}\"{} }} }}", place(), direction(entry)),
        "position" => "[0.5, -0.3, 0.0]".to_owned(),
        "success" => quote("result.success == true"),
        "poses" => format!("{{ window = {{ near = \"{}\", meters = 2.0 }} }}", place()),
        "patrol" => format!("{{ places = [\"{}\"], every = \"10min\" }}", place()),
        "endpoint" => quote("tcp/192.168.1.20:7447"),
        "places" if path.ends_with("ros2") => {
            format!("{{ {} = {{ x = 0.0, y = 0.0, yaw = 0.0 }} }}", place())
        }
        "places" => format!("[\"{}\"]", place()),
        "media" => "{ welcome = \"Welcome\" }".to_owned(),
        "quantity" => quote("co2"),
        "kind" => quote("lamp"),
        "broker" => quote("localhost:1883"),
        "line" => quote("GPIO17"),
        "to" => "[{ kind = \"ntfy\", url = \"https://ntfy.example/TOPIC\" }]".to_owned(),
        "max-size" => quote("1GiB"),
        "model" => {
            let domain = &ecosystem.domain.name;
            format!("'''(define (agent {}) (:domain {domain}) …)'''", entry.name)
        }
        "command" | "run" => "[\"PROGRAM\", \"ARGUMENT\"]".to_owned(),
        "range" => "100.0".to_owned(),
        "every" => quote("10min"),
        "battery" => "{ range = 100.0 }".to_owned(),
        _ => return None,
    })
}

/// Returns the key of a preset that says where the camera of an entry turns; empty if its driver needs
/// none.
fn direction(entry: &AgentEntry) -> &'static str {
    match entry.driver.as_deref() {
        Some("onvif") => ", preset = \"Door\"",
        Some("v4l2") => ", position = [0.5, -0.3, 0.0]",
        _ => "",
    }
}

/// Parses a value of TOML, such as one that [`example`] has returned.
pub(super) fn parsed(text: &str) -> Option<Value> {
    let table: toml::Table = format!("value = {text}").parse().ok()?;
    serde_json::to_value(table.get("value")?).ok()
}

/// Returns the name of the first object of the map that has the type `sort`.
fn place(ecosystem: &Ecosystem, sort: &str) -> Option<String> {
    let types = Types::of(&ecosystem.domain);
    let mut objects = ecosystem.problem.objects.iter().map(|declaration| &declaration.object);
    let is_one = |ty: &pddl::Name| types.is_subtype(ty.as_str(), sort);
    let found = objects.find(|object| object.ty.alternatives.iter().any(is_one));
    found.map(|object| object.name.as_str().to_owned())
}
