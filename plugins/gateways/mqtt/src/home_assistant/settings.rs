//! Entities of Home Assistant's discovery that are set, triggered or pressed: covers, fans, numbers,
//! choices, buttons, scenes and events.

use super::component::switched;
use super::config::EntityConfig;
use crate::description::{DeviceFeature, OutgoingMessage, ReadingMethod};
use crate::setting::{DeviceSetting, LevelSetting, NumberScale, PressText, TemplateVariable};

/// Device classes of covers that are ways for people, cars or air, and no shades.
const GATES: &[&str] = &["damper", "door", "garage", "gate", "window"];

/// Name of the thing to which all triggers of a device belong.
const TRIGGERS: &str = "triggers";

/// Adds the options of a choice to an entity: the topics under `NAME_command_topic` and
/// `NAME_state_topic`, with their templates. `options` are the options if the config has none.
/// Returns `None` if the config has no such command topic.
///
/// # Errors
///
/// Returns an error if a topic or a template is invalid.
pub(super) fn choice(
    class: &str,
    config: &EntityConfig,
    label: &str,
    (name, key): (&str, &str),
    options: &[&str],
) -> Result<Option<DeviceFeature>, String> {
    let topic = format!("{name}_command_topic");
    if !config.has(&topic) {
        return Ok(None);
    }
    let usual = || options.iter().map(|option| (*option).to_owned()).collect();
    let options = config.list(key).unwrap_or_else(usual);
    // Home Assistant names the template of a state in two ways.
    let by = [format!("{name}_state_template"), format!("{name}_value_template")];
    let by = by.iter().find(|by| config.has(by)).map_or("", String::as_str);
    let source = config.source(&format!("{name}_state_topic"), by, ReadingMethod::Whole)?;
    let template = format!("{name}_command_template");
    let messages = options.into_iter().map(|option| {
        let to = config.telegram(&topic, None, ("", ""))?.topic;
        let text = match config.has(&template) {
            true => config.rendered(&template, &[("value", option.as_str().into())], &[])?,
            false => option.clone(),
        };
        Ok((option, OutgoingMessage::new(to, text)))
    });
    let messages: Result<Vec<_>, String> = messages.collect();
    Ok(Some(DeviceFeature {
        states: source.into_iter().collect(),
        setting: Some(DeviceSetting::Choice(messages?)),
        ..DeviceFeature::named(class, label)
    }))
}

// === covers ===

/// Returns the features of a cover: it is opened and closed, its position and its tilt are set.
pub(super) fn cover(config: &EntityConfig, label: &str) -> Result<Vec<DeviceFeature>, String> {
    let is_gate = config.text("device_class").is_some_and(|class| GATES.contains(&class));
    let (class, level) = match is_gate {
        true => ("gate", "gate_position"),
        false => ("cover", "cover_position"),
    };
    let mut found = Vec::new();
    if config.has("command_topic") {
        found.push(open_and_closed(class, config, label)?);
    }
    found.extend(position(level, config, label)?);
    found.extend(tilt(config, label)?);
    let is_movable = |feature: &DeviceFeature| feature.setting.is_some();
    match found.first() {
        None => Err("it takes no commands".to_owned()),
        Some(only)
            if found.len() == 1
                && !is_movable(only)
                && only.states.is_empty()
                && config.has("position_topic") =>
        {
            Err("it reports only how far it is open".to_owned())
        }
        Some(_) => Ok(found),
    }
}

fn open_and_closed(
    class: &str,
    config: &EntityConfig,
    label: &str,
) -> Result<DeviceFeature, String> {
    let source = config.source("state_topic", "value_template", ReadingMethod::Whole)?;
    let payloads = [("payload_open", "OPEN"), ("payload_close", "CLOSE")];
    let states = [("state_open", "open"), ("state_closed", "closed")];
    let mut found = switched(class, config, label, payloads, states, source)?;
    let others =
        [("state_opening", "opening"), ("state_closing", "closing"), ("state_stopped", "stopped")];
    found.neither = others.iter().flat_map(|(key, word)| config.words(key, word)).collect();
    Ok(found)
}

fn position(
    class: &str,
    config: &EntityConfig,
    label: &str,
) -> Result<Option<DeviceFeature>, String> {
    if !config.has("set_position_topic") {
        return Ok(None);
    }
    let number = |key: &str, otherwise: f64| config.number(key).unwrap_or(otherwise);
    let (zero, full) = (number("position_closed", 0.0), number("position_open", 100.0));
    let percent = TemplateVariable::Percent { zero, full };
    let given = [("value", TemplateVariable::Own), ("position", percent)];
    let missing = ["entity_id", "position_closed", "position_open", "tilt_max", "tilt_min"];
    let message =
        config.number_message("set_position_topic", "set_position_template", &given, &missing)?;
    let source = config.source("position_topic", "position_template", ReadingMethod::Whole)?;
    let mut setting = LevelSetting::percent(message);
    (setting.min, setting.max) = (zero.min(full), zero.max(full));
    setting.scale = NumberScale::Percent { zero, full };
    setting.stop = stop(config)?;
    Ok(Some(DeviceFeature {
        states: source.into_iter().collect(),
        setting: Some(DeviceSetting::Level(setting)),
        ..DeviceFeature::named(class, label)
    }))
}

/// Returns the message that ends the movement of a cover; `None` if it has none.
fn stop(config: &EntityConfig) -> Result<Option<OutgoingMessage>, String> {
    let is_null = config.0.get("payload_stop").is_some_and(serde_json::Value::is_null);
    if is_null || !config.has("command_topic") {
        return Ok(None);
    }
    config.telegram("command_topic", None, ("payload_stop", "STOP")).map(Some)
}

fn tilt(config: &EntityConfig, label: &str) -> Result<Option<DeviceFeature>, String> {
    if !config.has("tilt_command_topic") {
        return Ok(None);
    }
    let number = |key: &str, otherwise: f64| config.number(key).unwrap_or(otherwise);
    let (zero, full) = (number("tilt_min", 0.0), number("tilt_max", 100.0));
    let given = [("value", TemplateVariable::Own), ("tilt_position", TemplateVariable::Own)];
    let missing = ["entity_id", "position_closed", "position_open", "tilt_max", "tilt_min"];
    let message =
        config.number_message("tilt_command_topic", "tilt_command_template", &given, &missing)?;
    let source =
        config.source("tilt_status_topic", "tilt_status_template", ReadingMethod::Whole)?;
    let mut setting = LevelSetting::percent(message);
    (setting.min, setting.max) = (zero.min(full), zero.max(full));
    setting.scale = NumberScale::Percent { zero, full };
    Ok(Some(DeviceFeature {
        states: source.into_iter().collect(),
        setting: Some(DeviceSetting::Level(setting)),
        ..DeviceFeature::named("cover_tilt", label)
    }))
}

// === fans ===

/// Returns a fan, with its speed and its mode if it has them.
pub(super) fn fan(fan: DeviceFeature, config: &EntityConfig) -> Result<Vec<DeviceFeature>, String> {
    let label = fan.label.clone();
    let mut found = vec![fan];
    if config.has("percentage_command_topic") {
        let number = |key: &str, otherwise: f64| config.number(key).unwrap_or(otherwise);
        let (low, high) = (number("speed_range_min", 1.0), number("speed_range_max", 100.0));
        let given = [("value", TemplateVariable::Own)];
        let message = config.number_message(
            "percentage_command_topic",
            "percentage_command_template",
            &given,
            &[],
        )?;
        let source = config.source(
            "percentage_state_topic",
            "percentage_value_template",
            ReadingMethod::Whole,
        )?;
        // The lowest speed of a fan is the first of its steps; 0 is off.
        let scale = NumberScale::Percent { zero: low - 1.0, full: high };
        let setting = LevelSetting { min: low, max: high, scale, ..LevelSetting::percent(message) };
        found.push(DeviceFeature {
            states: source.into_iter().collect(),
            setting: Some(DeviceSetting::Level(setting)),
            ..DeviceFeature::named("fan_speed", &label)
        });
    }
    let modes = choice("fan_mode", config, &label, ("preset_mode", "preset_modes"), &[])?;
    found.extend(modes);
    Ok(found)
}

// === single settings ===

/// Returns a number that is set. Its unit does not count, because the class has none.
pub(super) fn number(config: &EntityConfig, label: &str) -> Result<DeviceFeature, String> {
    let given = [("value", TemplateVariable::Own)];
    let message = config.number_message("command_topic", "command_template", &given, &[])?;
    let source = config.source("state_topic", "value_template", ReadingMethod::Whole)?;
    let setting = LevelSetting {
        min: config.number("min").unwrap_or(1.0),
        max: config.number("max").unwrap_or(100.0),
        step: Some(config.number("step").unwrap_or(1.0)),
        scale: NumberScale::Unit,
        ..LevelSetting::percent(message)
    };
    Ok(DeviceFeature {
        states: source.into_iter().collect(),
        setting: Some(DeviceSetting::Level(setting)),
        ..DeviceFeature::named("number", label)
    })
}

pub(super) fn select(config: &EntityConfig, label: &str) -> Result<DeviceFeature, String> {
    let options = config.list("options").ok_or("it has no `options`")?;
    let message = |option: String| {
        let to = config.telegram("command_topic", None, ("", ""))?.topic;
        let text = match config.has("command_template") {
            true => {
                config.rendered("command_template", &[("value", option.as_str().into())], &[])?
            }
            false => option.clone(),
        };
        Ok((option, OutgoingMessage::new(to, text)))
    };
    let options: Result<Vec<_>, String> = options.into_iter().map(message).collect();
    let source = config.source("state_topic", "value_template", ReadingMethod::Whole)?;
    Ok(DeviceFeature {
        states: source.into_iter().collect(),
        setting: Some(DeviceSetting::Choice(options?)),
        ..DeviceFeature::named("select", label)
    })
}

/// Returns a button or a scene: a message triggers it.
pub(super) fn trigger(
    component: &str,
    config: &EntityConfig,
    label: &str,
) -> Result<DeviceFeature, String> {
    let payload =
        if component == "button" { ("payload_press", "PRESS") } else { ("payload_on", "ON") };
    let message = config.telegram("command_topic", Some("command_template"), payload)?;
    let setting = Some(DeviceSetting::Trigger(message));
    Ok(DeviceFeature { setting, ..DeviceFeature::named(component, label) })
}

// === presses ===

pub(super) fn event(config: &EntityConfig, label: &str) -> Result<DeviceFeature, String> {
    let whole = ReadingMethod::At(vec!["event_type".to_owned()]);
    let source = config.source("state_topic", "value_template", whole)?;
    let kinds = config.list("event_types").ok_or("it has no `event_types`")?;
    let presses = kinds.iter().map(|kind| PressText::named(kind)).collect();
    Ok(DeviceFeature {
        states: source.into_iter().collect(),
        setting: Some(DeviceSetting::Press(presses)),
        ..DeviceFeature::named("action", label)
    })
}

/// Returns one trigger of a device, named by its type and its subtype.
pub(super) fn automation(config: &EntityConfig) -> Result<DeviceFeature, String> {
    let source = config.source("topic", "value_template", ReadingMethod::Whole)?;
    let source = source.ok_or("it has no `topic`")?;
    let text = config.payload("payload", "");
    if text.is_empty() {
        return Err("its trigger has no `payload`: any message would be a press".to_owned());
    }
    let (kind, subtype) = (config.text("type"), config.text("subtype"));
    let name = [kind, subtype].into_iter().flatten().collect::<Vec<_>>().join(" ");
    let press = PressText { name, text, source: Some(0) };
    Ok(DeviceFeature {
        states: vec![source],
        setting: Some(DeviceSetting::Press(vec![press])),
        thing: Some(TRIGGERS.to_owned()),
        ..DeviceFeature::named("action", TRIGGERS)
    })
}
