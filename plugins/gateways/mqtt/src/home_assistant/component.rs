//! Converts each component of Home Assistant's discovery into features, or into a reason why it is
//! not used. `lighting`, `climate` and `settings` convert those that are set.

use serde_json::json;

use super::config::EntityConfig;
use super::{climate, lighting, settings};
use crate::description::{
    DeviceFeature, OutgoingMessage, ReadingMethod, SwitchCommand, UnusedFeature, ValueSource,
};
use crate::room_air::rank;
use crate::setting::DeviceSetting;
use crate::template::Template;

/// Components of Home Assistant that have no use here, with the reasons.
const UNUSED: &[(&str, &str)] = &[
    ("alarm_control_panel", "arming and disarming an alarm is left to people"),
    ("camera", "a picture is no fact of a room"),
    ("device_tracker", "no fact of a room says where a thing or a person is"),
    ("image", "a picture is no fact of a room"),
    ("lawn_mower", "it works outside of rooms"),
    ("notify", "a notification is for people"),
    ("tag", "a tag that is read is an event and no state"),
    ("text", "there is no class for a text that is set"),
    ("update", "updating its software is left to people"),
    ("vacuum", "it does not report in which room it cleans"),
    ("water_heater", "it measures its water, not the room"),
];

/// Variables that the template of a light may use, and that are undefined in a command that only
/// switches the light on or off.
pub(super) const OF_LIGHTS: &[&str] = &[
    "blue",
    "brightness",
    "color_temp",
    "effect",
    "flash",
    "green",
    "hue",
    "red",
    "sat",
    "transition",
];

/// Components of Home Assistant, each with the key of the topic that its config must have.
const REQUIRED: &[(&str, &str)] = &[
    ("binary_sensor", "state_topic"),
    ("button", "command_topic"),
    ("device_automation", "topic"),
    ("event", "state_topic"),
    ("fan", "command_topic"),
    ("light", "command_topic"),
    ("lock", "command_topic"),
    ("number", "command_topic"),
    ("scene", "command_topic"),
    ("select", "command_topic"),
    ("sensor", "state_topic"),
    ("siren", "command_topic"),
    ("switch", "command_topic"),
];

/// Returns the reason why a config does not have the form that its component requires; `None` if it
/// has. A valid config of a thing without any use here is not malformed.
pub(crate) fn malformed(component: &str, config: &EntityConfig) -> Option<String> {
    let mut required = REQUIRED.iter().filter(|(name, _)| *name == component);
    if let Some((_, topic)) = required.find(|(_, topic)| config.text(topic).is_none()) {
        return Some(format!("it has no `{topic}`"));
    }
    let keys = || config.0.keys().filter_map(|key| Some((key, config.text(key)?)));
    if !keys().any(|(key, _)| key.ends_with("topic")) {
        return Some("it names no topic".to_owned());
    }
    keys().find_map(|(key, text)| match key.rsplit('_').next() {
        Some("topic") if key.ends_with("command_topic") => mqtt_link::topic_problem(text),
        Some("topic") => mqtt_link::filter_problem(text),
        Some("template") => template_error(text),
        _ => None,
    })
}

/// Returns the syntax error in a template; `None` if there is none. The use of an unknown filter or
/// function is not a syntax error.
fn template_error(text: &str) -> Option<String> {
    let problem = Template::new(text, &[]).err()?;
    problem.contains("syntax error").then_some(problem)
}

/// Returns the features of an entity, or the reason why the entity has none.
pub(crate) fn features(
    component: &str,
    config: &EntityConfig,
    label: &str,
) -> Result<Vec<DeviceFeature>, UnusedFeature> {
    let named = || match config.text("name") {
        Some(name) => format!("its {component} `{name}`"),
        None => format!("its {component}"),
    };
    let because = |problem: String| UnusedFeature::because(format!("{}: {problem}", named()));
    if config.is("enabled_by_default") == Some(false) {
        return Err(UnusedFeature::as_usual(format!("{}: it is not enabled by default", named())));
    }
    if let Some(category) = config.text("entity_category") {
        let reason = format!("{}: it is about the device itself ({category})", named());
        return Err(UnusedFeature::as_usual(reason));
    }
    if let Some((_, reason)) = UNUSED.iter().find(|(unused, _)| *unused == component) {
        return Err(because((*reason).to_owned()));
    }
    let found = match component {
        "sensor" => sensor(config, label).map(|found| vec![found]),
        "binary_sensor" => binary_sensor(config, label).map(|found| vec![found]),
        "switch" => switch(config, label).map(|found| vec![found]),
        "light" => light(config, label).and_then(|light| lighting::with_levels(light, config)),
        "lock" => lock(config, label).map(|found| vec![found]),
        "climate" => climate::climate(config, label),
        "humidifier" => climate::humidifier(config, label),
        "fan" => on_off(component, config, label).and_then(|fan| settings::fan(fan, config)),
        "siren" => on_off(component, config, label).map(|found| vec![found]),
        "cover" => settings::cover(config, label),
        "valve" => open_close(component, config, label).map(|found| vec![found]),
        "number" => settings::number(config, label).map(|found| vec![found]),
        "select" => settings::select(config, label).map(|found| vec![found]),
        "button" | "scene" => settings::trigger(component, config, label).map(|found| vec![found]),
        "event" => settings::event(config, label).map(|found| vec![found]),
        "device_automation" => settings::automation(config).map(|found| vec![found]),
        _ => Err(format!("Home Assistant's discovery has no component `{component}`")),
    };
    let availability = config.availability().map_err(because)?;
    let mut found = found.map_err(because)?;
    name_thing(&mut found, component, config, label);
    for feature in &mut found {
        feature.availability = availability.clone();
        if config.is("retain") == Some(true) {
            if let Some(command) = &mut feature.command {
                (command.on.is_retained, command.off.is_retained) = (true, true);
            }
            feature.setting.iter_mut().for_each(DeviceSetting::retain);
        }
    }
    Ok(found)
}

/// Makes the settable features of one entity the properties of one thing, if there are several.
fn name_thing(features: &mut [DeviceFeature], component: &str, config: &EntityConfig, label: &str) {
    let is_settable =
        |feature: &DeviceFeature| feature.command.is_some() || feature.setting.is_some();
    if features.iter().filter(|feature| is_settable(feature)).count() < 2 {
        return;
    }
    let thing = format!("{component} {}", config.text("unique_id").unwrap_or(label));
    for feature in features.iter_mut().filter(|feature| is_settable(feature)) {
        feature.thing = Some(thing.clone());
    }
}

fn sensor(config: &EntityConfig, label: &str) -> Result<DeviceFeature, String> {
    let unit = config.payload("unit_of_measurement", "");
    let class = match config.text("device_class") {
        Some(class) => class,
        None => class_of_unit(&unit).ok_or("it does not say its device class")?,
    };
    if class == "illuminance" && unit.is_empty() {
        return Err("it has no unit, so its values may be raw".to_owned());
    }
    let source = config.source("state_topic", "value_template", ReadingMethod::Whole)?;
    Ok(DeviceFeature {
        states: vec![source.ok_or("it has no `state_topic`")?],
        unit,
        expires: config.duration("expire_after"),
        rank: rank(label, config.text("name")),
        ..DeviceFeature::named(class, label)
    })
}

fn binary_sensor(config: &EntityConfig, label: &str) -> Result<DeviceFeature, String> {
    let class = config.text("device_class").ok_or("it does not say its device class")?;
    let source = config.source("state_topic", "value_template", ReadingMethod::Whole)?;
    Ok(DeviceFeature {
        states: vec![source.ok_or("it has no `state_topic`")?],
        yes: config.words("payload_on", "ON"),
        no: config.words("payload_off", "OFF"),
        expires: config.duration("expire_after"),
        off_delay: config.duration("off_delay"),
        ..DeviceFeature::named(class, label)
    })
}

/// Returns the device class for a unit, for a sensor without a class; `None` if the unit does not
/// determine the class.
fn class_of_unit(unit: &str) -> Option<&'static str> {
    match unit {
        "°C" | "°F" => Some("temperature"),
        "lx" => Some("illuminance"),
        _ => None,
    }
}

/// Returns a feature that two payloads switch. Its state is reported by the same payloads or by two
/// others.
pub(super) fn switched(
    class: &str,
    config: &EntityConfig,
    label: &str,
    payloads: [(&str, &str); 2],
    states: [(&str, &str); 2],
    source: Option<ValueSource>,
) -> Result<DeviceFeature, String> {
    let [on, off] = payloads;
    for (payload, _) in payloads {
        // To Home Assistant, a `null` payload means that there is no such command.
        if config.0.get(payload).is_some_and(serde_json::Value::is_null) {
            return Err(format!("its `{payload}` is null: it takes no such command"));
        }
    }
    let command = SwitchCommand {
        on: config.telegram("command_topic", Some("command_template"), on)?,
        off: config.telegram("command_topic", Some("command_template"), off)?,
    };
    // The device reports the payload of the command, unless the config has another text.
    let words = |state: (&str, &str), payload: (&str, &str)| match config.has(state.0) {
        true => config.words(state.0, state.1),
        false if state.1.is_empty() => config.words(payload.0, payload.1),
        false => vec![state.1.to_owned()],
    };
    let [yes, no] = [words(states[0], on), words(states[1], off)];
    let states = source.into_iter().collect();
    Ok(DeviceFeature {
        states,
        yes,
        no,
        command: Some(command),
        ..DeviceFeature::named(class, label)
    })
}

fn switch(config: &EntityConfig, label: &str) -> Result<DeviceFeature, String> {
    let source = config.source("state_topic", "value_template", ReadingMethod::Whole)?;
    let payloads = [("payload_on", "ON"), ("payload_off", "OFF")];
    switched("switch", config, label, payloads, [("state_on", ""), ("state_off", "")], source)
}

fn light(config: &EntityConfig, label: &str) -> Result<DeviceFeature, String> {
    match config.text("schema").unwrap_or("basic") {
        "basic" | "default" => basic_light(config, label),
        "json" => json_light(config, label),
        "template" => template_light(config, label),
        other => Err(format!("its schema `{other}` is not known here")),
    }
}

fn basic_light(config: &EntityConfig, label: &str) -> Result<DeviceFeature, String> {
    let by =
        if config.has("state_value_template") { "state_value_template" } else { "value_template" };
    let source = config.source("state_topic", by, ReadingMethod::Whole)?;
    let payloads = [("payload_on", "ON"), ("payload_off", "OFF")];
    let none = ("", "");
    let mut light = switched("light", config, label, payloads, [none, none], source)?;
    if config.text("on_command_type") == Some("brightness") {
        // This light is switched on by setting its brightness, and in no other way.
        let full = config.payload("brightness_scale", "255");
        let number: f64 = full
            .trim()
            .parse()
            .map_err(|_| format!("its `brightness_scale` `{full}` is no number"))?;
        #[allow(clippy::cast_possible_truncation, reason = "a brightness is a whole number")]
        let full = number.round() as i64;
        let topic = config.telegram("brightness_command_topic", None, ("", ""))?.topic;
        let text = match config.has("brightness_command_template") {
            true => {
                config.rendered("brightness_command_template", &[("value", full.into())], &[])?
            }
            false => full.to_string(),
        };
        if let Some(command) = &mut light.command {
            command.on = OutgoingMessage::new(topic, text);
        }
    }
    Ok(light)
}

fn json_light(config: &EntityConfig, label: &str) -> Result<DeviceFeature, String> {
    let text = |state: &str| json!({ "state": state }).to_string();
    let to = config.telegram("command_topic", None, ("", ""))?.topic;
    let state = config.source("state_topic", "", ReadingMethod::At(vec!["state".to_owned()]))?;
    Ok(DeviceFeature {
        states: state.into_iter().collect(),
        yes: vec!["ON".to_owned()],
        no: vec!["OFF".to_owned()],
        command: Some(SwitchCommand {
            on: OutgoingMessage::new(&*to, text("ON")),
            off: OutgoingMessage::new(&*to, text("OFF")),
        }),
        ..DeviceFeature::named("light", label)
    })
}

fn template_light(config: &EntityConfig, label: &str) -> Result<DeviceFeature, String> {
    let to = config.telegram("command_topic", None, ("", ""))?.topic;
    let state = match config.has("state_template") {
        true => config.source("state_topic", "state_template", ReadingMethod::Whole)?,
        false => None,
    };
    let on = config.rendered("command_on_template", &[("state", "on".into())], OF_LIGHTS)?;
    let off = config.rendered("command_off_template", &[("state", "off".into())], OF_LIGHTS)?;
    Ok(DeviceFeature {
        states: state.into_iter().collect(),
        yes: vec!["on".to_owned()],
        no: vec!["off".to_owned()],
        command: Some(SwitchCommand {
            on: OutgoingMessage::new(&*to, on),
            off: OutgoingMessage::new(&*to, off),
        }),
        ..DeviceFeature::named("light", label)
    })
}

fn lock(config: &EntityConfig, label: &str) -> Result<DeviceFeature, String> {
    let code = "it needs a code, and plans contain no codes";
    if config.has("code_format") {
        return Err(code.to_owned());
    }
    if config.text("command_template").is_some_and(|template| wants(template, "code")) {
        return Err(code.to_owned());
    }
    let source = config.source("state_topic", "value_template", ReadingMethod::Whole)?;
    let payloads = [("payload_lock", "LOCK"), ("payload_unlock", "UNLOCK")];
    let states = [("state_locked", "LOCKED"), ("state_unlocked", "UNLOCKED")];
    let mut lock = switched("lock", config, label, payloads, states, source)?;
    let others = [
        ("state_jammed", "JAMMED"),
        ("state_locking", "LOCKING"),
        ("state_unlocking", "UNLOCKING"),
        ("payload_reset", "None"),
    ];
    lock.neither = others.iter().flat_map(|(key, word)| config.words(key, word)).collect();
    Ok(lock)
}

/// Whether a template requires a variable: it is invalid without the variable, and valid with it.
fn wants(template: &str, variable: &str) -> bool {
    Template::new(template, &["value"]).is_err()
        && Template::new(template, &["value", variable]).is_ok()
}

fn on_off(component: &str, config: &EntityConfig, label: &str) -> Result<DeviceFeature, String> {
    let payloads = [("payload_on", "ON"), ("payload_off", "OFF")];
    if component == "fan" {
        let source = config.source("state_topic", "state_value_template", ReadingMethod::Whole)?;
        return switched(component, config, label, payloads, [("", ""), ("", "")], source);
    }
    let whole = ReadingMethod::At(vec!["state".to_owned()]);
    let source = config.source("state_topic", "state_value_template", whole)?;
    let states = [("state_on", ""), ("state_off", "")];
    let mut siren = switched(component, config, label, payloads, states, source)?;
    let Some(command) = &mut siren.command else { return Ok(siren) };
    // Without a template, the commands for a siren are in JSON.
    if !config.has("command_template") {
        for telegram in [&mut command.on, &mut command.off] {
            telegram.text = json!({ "state": telegram.text }).to_string();
        }
    }
    if config.has("command_off_template") {
        let off = config.payload_in_python("payload_off", "OFF");
        command.off.text =
            config.rendered("command_off_template", &[("value", off.into())], &[])?;
    }
    Ok(siren)
}

fn open_close(
    component: &str,
    config: &EntityConfig,
    label: &str,
) -> Result<DeviceFeature, String> {
    if config.is("reports_position") == Some(true) || !config.has("state_topic") {
        return Err("it reports only how far it is open".to_owned());
    }
    let source = config.source("state_topic", "value_template", ReadingMethod::Whole)?;
    let payloads = [("payload_open", "OPEN"), ("payload_close", "CLOSE")];
    let states = [("state_open", "open"), ("state_closed", "closed")];
    let mut found = switched(component, config, label, payloads, states, source)?;
    let others = [("state_opening", "opening"), ("state_closing", "closing")];
    found.neither = others.iter().flat_map(|(key, word)| config.words(key, word)).collect();
    Ok(found)
}
