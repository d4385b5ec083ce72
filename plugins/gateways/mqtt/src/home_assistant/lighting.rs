//! The settings of a light of Home Assistant's discovery: its brightness, its color temperature and
//! its color.

use serde_json::{Value, json};

use super::component::OF_LIGHTS;
use super::config::EntityConfig;
use crate::color::{COLORS, NamedColor};
use crate::description::{DeviceFeature, OutgoingMessage, ReadingMethod, ValueSource};
use crate::setting::{DeviceSetting, LevelSetting, NumberMessage, NumberScale, TemplateVariable};

/// Usual bounds of color temperatures, in mireds.
const MIREDS: (f64, f64) = (153.0, 500.0);

/// Usual bounds of color temperatures, in kelvins.
const KELVINS: (f64, f64) = (2_000.0, 6_535.0);

/// Returns a light with its levels.
///
/// # Errors
///
/// Returns an error if a topic or a template is invalid.
pub(super) fn with_levels(
    light: DeviceFeature,
    config: &EntityConfig,
) -> Result<Vec<DeviceFeature>, String> {
    let label = light.label.clone();
    let (brightness, warmth) = match config.text("schema").unwrap_or("basic") {
        "json" => (json_brightness(config)?, json_color_temperature(config)?),
        "template" => (template_brightness(config)?, None),
        _ => (basic_brightness(config)?, basic_color_temperature(config)?),
    };
    let named = |(class, feature): (&str, DeviceFeature)| DeviceFeature {
        class: class.to_owned(),
        label: label.clone(),
        ..feature
    };
    let brightness = brightness.map(|feature| ("brightness", feature));
    let warmth = warmth.map(|feature| ("color_temp", feature));
    let color = match config.text("schema").unwrap_or("basic") {
        "json" => json_color(config)?,
        "template" => None,
        _ => basic_color(config)?,
    };
    let color = color.map(|feature| ("color", feature));
    let levels = brightness.into_iter().chain(warmth).chain(color).map(named);
    Ok(std::iter::once(light).chain(levels).collect())
}

fn level(
    message: NumberMessage,
    source: Option<ValueSource>,
    (min, max): (f64, f64),
    scale: NumberScale,
    switches_on: bool,
) -> DeviceFeature {
    let setting = LevelSetting { min, max, scale, switches_on, ..LevelSetting::percent(message) };
    DeviceFeature {
        states: source.into_iter().collect(),
        setting: Some(DeviceSetting::Level(setting)),
        ..DeviceFeature::named("", "")
    }
}

/// Returns the number for full brightness.
fn full_brightness(config: &EntityConfig) -> f64 {
    config.number("brightness_scale").unwrap_or(255.0)
}

fn basic_brightness(config: &EntityConfig) -> Result<Option<DeviceFeature>, String> {
    if !config.has("brightness_command_topic") {
        return Ok(None);
    }
    let given = [("value", TemplateVariable::Own)];
    let message = config.number_message(
        "brightness_command_topic",
        "brightness_command_template",
        &given,
        &[],
    )?;
    let source = config.source(
        "brightness_state_topic",
        "brightness_value_template",
        ReadingMethod::Whole,
    )?;
    let full = full_brightness(config);
    let scale = NumberScale::Percent { zero: 0.0, full };
    let switches_on = config.text("on_command_type") == Some("brightness");
    Ok(Some(level(message, source, (1.0, full), scale, switches_on)))
}

fn basic_color_temperature(config: &EntityConfig) -> Result<Option<DeviceFeature>, String> {
    if !config.has("color_temp_command_topic") {
        return Ok(None);
    }
    let given = [("value", TemplateVariable::Own)];
    let message = config.number_message(
        "color_temp_command_topic",
        "color_temp_command_template",
        &given,
        &[],
    )?;
    let source = config.source(
        "color_temp_state_topic",
        "color_temp_value_template",
        ReadingMethod::Whole,
    )?;
    let (bounds, scale) = color_temperatures(config);
    Ok(Some(level(message, source, bounds, scale, false)))
}

/// Returns the bounds of the color temperatures, and their scale.
fn color_temperatures(config: &EntityConfig) -> ((f64, f64), NumberScale) {
    let number = |key: &str, otherwise: f64| config.number(key).unwrap_or(otherwise);
    match config.is("color_temp_kelvin") {
        Some(true) => {
            let bounds = (number("min_kelvin", KELVINS.0), number("max_kelvin", KELVINS.1));
            (bounds, NumberScale::Unit)
        }
        _ => {
            let bounds = (number("min_mireds", MIREDS.0), number("max_mireds", MIREDS.1));
            (bounds, NumberScale::Mired)
        }
    }
}

/// Returns the modes of color that a light of the JSON schema supports.
fn modes(config: &EntityConfig) -> Vec<String> {
    config.list("supported_color_modes").unwrap_or_default()
}

fn json_message(config: &EntityConfig, key: &str) -> Result<NumberMessage, String> {
    let to = config.telegram("command_topic", None, ("", ""))?.topic;
    let mut body = json!({ "state": "ON" });
    body[key] = Value::Null;
    Ok(NumberMessage::json(to, body, &format!("/{key}")))
}

fn json_brightness(config: &EntityConfig) -> Result<Option<DeviceFeature>, String> {
    let has_mode = modes(config).iter().any(|mode| mode != "onoff");
    if config.is("brightness") != Some(true) && !has_mode {
        return Ok(None);
    }
    let at = ReadingMethod::At(vec!["brightness".to_owned()]);
    let source = config.source("state_topic", "", at)?;
    let full = full_brightness(config);
    let scale = NumberScale::Percent { zero: 0.0, full };
    let message = json_message(config, "brightness")?;
    Ok(Some(level(message, source, (1.0, full), scale, true)))
}

fn json_color_temperature(config: &EntityConfig) -> Result<Option<DeviceFeature>, String> {
    let has_mode = modes(config).iter().any(|mode| mode == "color_temp");
    if config.is("color_temp") != Some(true) && !has_mode {
        return Ok(None);
    }
    let at = ReadingMethod::At(vec!["color_temp".to_owned()]);
    let source = config.source("state_topic", "", at)?;
    let (bounds, scale) = color_temperatures(config);
    let message = json_message(config, "color_temp")?;
    Ok(Some(level(message, source, bounds, scale, true)))
}

fn template_brightness(config: &EntityConfig) -> Result<Option<DeviceFeature>, String> {
    if !config.has("brightness_template") {
        return Ok(None);
    }
    let state = TemplateVariable::Constant("on".to_owned());
    let given = [("brightness", TemplateVariable::Own), ("state", state)];
    let message =
        config.number_message("command_topic", "command_on_template", &given, OF_LIGHTS)?;
    let source = config.source("state_topic", "brightness_template", ReadingMethod::Whole)?;
    let scale = NumberScale::Percent { zero: 0.0, full: 255.0 };
    Ok(Some(level(message, source, (1.0, 255.0), scale, true)))
}

/// Returns the color of a light of the JSON schema.
fn json_color(config: &EntityConfig) -> Result<Option<DeviceFeature>, String> {
    let modes = modes(config);
    let has = |kind: &str| modes.iter().any(|mode| mode == kind);
    let kind = ["hs", "xy", "rgb", "rgbw", "rgbww"].into_iter().find(|kind| has(kind));
    let Some(kind) = kind else { return Ok(None) };
    let to = config.telegram("command_topic", None, ("", ""))?.topic;
    let option = |color: NamedColor| {
        let mut parts = color.json(kind);
        // A lamp with white light of its own does not add it to a color.
        let whites = match kind {
            "rgbw" => &["w"][..],
            "rgbww" => &["c", "w"],
            _ => &[],
        };
        for white in whites {
            parts[*white] = json!(0);
        }
        let body = json!({ "state": "ON", "color": parts }).to_string();
        (color.name.to_owned(), OutgoingMessage::new(to.as_str(), body))
    };
    let reading = ReadingMethod::Color(vec!["color".to_owned()]);
    let source = config.source("state_topic", "", reading)?;
    Ok(Some(colored(COLORS.map(option).to_vec(), source)))
}

/// Returns the color of a basic light, which has a topic of its own. The numbers that such a light
/// reports are not read, so the last command counts.
fn basic_color(config: &EntityConfig) -> Result<Option<DeviceFeature>, String> {
    let Some(kind) =
        ["hs", "xy", "rgb"].into_iter().find(|kind| config.has(&format!("{kind}_command_topic")))
    else {
        return Ok(None);
    };
    let to = config.telegram(&format!("{kind}_command_topic"), None, ("", ""))?.topic;
    let by = format!("{kind}_command_template");
    let mut options = Vec::new();
    for color in COLORS {
        let ([red, green, blue], (x, y)) = (color.rgb(), color.xy());
        let (names, numbers) = match kind {
            "hs" => (&["hue", "sat"][..], vec![color.hue, 100.0]),
            "xy" => (&["x", "y"][..], vec![x, y]),
            _ => (&["red", "green", "blue"][..], [red, green, blue].map(f64::from).to_vec()),
        };
        let text = match config.has(&by) {
            true => {
                let given = names.iter().zip(&numbers);
                let given: Vec<_> = given.map(|(name, number)| (*name, (*number).into())).collect();
                config.rendered(&by, &given, &["value"])?
            }
            false => numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(","),
        };
        options.push((color.name.to_owned(), OutgoingMessage::new(to.as_str(), text)));
    }
    Ok(Some(colored(options, None)))
}

fn colored(options: Vec<(String, OutgoingMessage)>, source: Option<ValueSource>) -> DeviceFeature {
    DeviceFeature {
        states: source.into_iter().collect(),
        setting: Some(DeviceSetting::Choice(options)),
        ..DeviceFeature::named("", "")
    }
}
