//! Thermostats and humidifiers of Home Assistant's discovery: what they measure in the room, their
//! set points, modes and programs.

use super::component::switched;
use super::config::EntityConfig;
use super::settings::choice;
use crate::description::{DeviceFeature, ReadingMethod};
use crate::setting::{DeviceSetting, LevelSetting, NumberScale, TemplateVariable};

/// Modes of a thermostat that lists none.
const MODES: &[&str] = &["auto", "off", "cool", "heat", "dry", "fan_only"];

/// Speeds of the fan of a thermostat that lists none.
const FAN_MODES: &[&str] = &["auto", "low", "medium", "high"];

/// Bounds of a set point that are usual, in °C and in °F.
const CELSIUS: (f64, f64) = (7.0, 35.0);
const FAHRENHEIT: (f64, f64) = (45.0, 95.0);

/// Returns the features of a thermostat.
///
/// # Errors
///
/// Returns an error if a topic or a template is invalid, or there are no features.
pub(super) fn climate(config: &EntityConfig, label: &str) -> Result<Vec<DeviceFeature>, String> {
    let is_fahrenheit = config.text("temperature_unit") == Some("F");
    let (unit, bounds) = if is_fahrenheit { ("°F", FAHRENHEIT) } else { ("°C", CELSIUS) };
    let mut found = measured(config, label, unit)?;
    for (class, name) in [
        ("heating_setpoint", "temperature"),
        ("heating_setpoint", "temperature_low"),
        ("cooling_setpoint", "temperature_high"),
    ] {
        let has_one = found.iter().any(|feature| feature.class == class);
        let setting = set_point(class, config, label, name, ("min_temp", "max_temp", bounds))?;
        found.extend(
            setting
                .filter(|_| !has_one)
                .map(|setting| DeviceFeature { unit: unit.to_owned(), ..setting }),
        );
    }
    for (class, names, options) in [
        ("thermostat_mode", ("mode", "modes"), MODES),
        ("thermostat_program", ("preset_mode", "preset_modes"), &[][..]),
        ("thermostat_fan", ("fan_mode", "fan_modes"), FAN_MODES),
    ] {
        found.extend(choice(class, config, label, names, options)?);
    }
    if found.is_empty() {
        Err("it neither measures nor sets anything".to_owned())
    } else {
        Ok(found)
    }
}

/// Returns the features of a humidifier.
///
/// # Errors
///
/// Returns an error if a topic or a template is invalid, or there are no features.
pub(super) fn humidifier(config: &EntityConfig, label: &str) -> Result<Vec<DeviceFeature>, String> {
    let mut found = measured(config, label, "°C")?;
    if config.has("command_topic") {
        let by = "state_value_template";
        let source = config.source("state_topic", by, ReadingMethod::Whole)?;
        let payloads = [("payload_on", "ON"), ("payload_off", "OFF")];
        let none = ("", "");
        found.push(switched("humidifier", config, label, payloads, [none, none], source)?);
    }
    let bounds = ("min_humidity", "max_humidity", (0.0, 100.0));
    found.extend(set_point("humidity_setpoint", config, label, "target_humidity", bounds)?);
    if found.is_empty() {
        Err("it neither measures nor sets anything".to_owned())
    } else {
        Ok(found)
    }
}

/// Returns the features for the room's air, as measured by a heater or a humidifier.
fn measured(
    config: &EntityConfig,
    label: &str,
    degrees: &str,
) -> Result<Vec<DeviceFeature>, String> {
    let mut found = Vec::new();
    for (class, topic, by, unit) in [
        ("temperature", "current_temperature_topic", "current_temperature_template", degrees),
        ("humidity", "current_humidity_topic", "current_humidity_template", "%"),
    ] {
        if let Some(source) = config.source(topic, by, ReadingMethod::Whole)? {
            let (states, unit) = (vec![source], unit.to_owned());
            // A separate sensor in the same device is more accurate.
            found.push(DeviceFeature {
                states,
                unit,
                rank: 1,
                ..DeviceFeature::named(class, label)
            });
        }
    }
    Ok(found)
}

/// Returns a set point: the topics under `NAME_command_topic` and `NAME_state_topic`, with bounds
/// under two keys. Returns `None` if the config has no such command topic.
fn set_point(
    class: &str,
    config: &EntityConfig,
    label: &str,
    name: &str,
    (lowest, highest, usual): (&str, &str, (f64, f64)),
) -> Result<Option<DeviceFeature>, String> {
    let topic = format!("{name}_command_topic");
    if !config.has(&topic) {
        return Ok(None);
    }
    let given = [("value", TemplateVariable::Own)];
    let by = format!("{name}_command_template");
    let message = config.number_message(&topic, &by, &given, &[])?;
    let (state, by) = (format!("{name}_state_topic"), format!("{name}_state_template"));
    let source = config.source(&state, &by, ReadingMethod::Whole)?;
    let setting = LevelSetting {
        min: config.number(lowest).unwrap_or(usual.0),
        max: config.number(highest).unwrap_or(usual.1),
        step: Some(config.number("temp_step").unwrap_or(1.0)),
        scale: NumberScale::Unit,
        ..LevelSetting::percent(message)
    };
    Ok(Some(DeviceFeature {
        states: source.into_iter().collect(),
        setting: Some(DeviceSetting::Level(setting)),
        ..DeviceFeature::named(class, label)
    }))
}
