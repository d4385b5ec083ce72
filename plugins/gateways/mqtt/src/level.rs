//! Divides a level setting into the levels that plans may use: numbers in the unit of the device
//! class, each with the name of its object and the message that sets it. The planner has no
//! numeric parameters of actions, so each level is an object.

use actuator::{is_possible_value, unit_conversion};

use crate::message::OutgoingMessage;
use crate::setting::{LevelSetting, NumberScale};

/// Maximum number of levels of one setting. A thermostat from 5 to 35 °C in half degrees has 61.
const LEVELS_MAX: usize = 64;

/// Number of a device's own steps up to which each of them becomes a level: a fan with three
/// speeds has these three. Above it, the levels are those of the class.
const OWN_STEPS_MAX: usize = 21;

/// Number of decimals of a level. A level's name follows from its number, so levels of several
/// devices with the same number are the same object.
const DECIMALS: i32 = 3;

/// Number that is half as far from the middle of all weights as the greatest number, for levels
/// without a unit.
const MIDDLE_NUMBER: f64 = 10.0;

/// One level of a setting.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SettableLevel {
    /// Name of the level's object in PDDL.
    pub(crate) name: String,
    /// The number, in the unit of the class.
    pub(crate) amount: f64,
    /// The number in the device's own scale.
    pub(crate) own: f64,
    pub(crate) message: OutgoingMessage,
}

/// The levels of a setting, and the conversion between them and the device's own numbers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SettableLevels {
    /// The levels, in ascending order of their numbers.
    pub(crate) levels: Vec<SettableLevel>,
    scale: UnitScale,
    /// Message that ends a movement; `None` if the device cannot be stopped.
    pub(crate) stop: Option<OutgoingMessage>,
    /// Whether a level's message also switches the thing on.
    pub(crate) switches_on: bool,
}

/// Conversion of a device's own numbers to numbers in the unit of a class.
#[derive(Clone, Copy, Debug, PartialEq)]
enum UnitScale {
    Linear { factor: f64, offset: f64 },
    Mired,
}

impl UnitScale {
    /// Returns the scale of a setting in a class of the unit `unit`.
    ///
    /// # Errors
    ///
    /// Returns the reason if the numbers cannot be converted.
    fn of(scale: NumberScale, own_unit: &str, unit: &str) -> Result<UnitScale, String> {
        match scale {
            NumberScale::Unit => match unit_conversion(own_unit, unit) {
                Some((factor, offset)) => Ok(UnitScale::Linear { factor, offset }),
                None => Err(format!("it is in `{own_unit}`, which is no {unit}")),
            },
            NumberScale::Percent { zero, full } => {
                let factor = 100.0 / (full - zero);
                let scale = UnitScale::Linear { factor, offset: -zero * factor };
                let is_usable = factor.is_finite() && factor != 0.0 && zero.is_finite();
                is_usable
                    .then_some(scale)
                    .ok_or_else(|| format!("its numbers for 0 % and 100 % are {zero} and {full}"))
            }
            NumberScale::Mired => Ok(UnitScale::Mired),
        }
    }

    fn amount(self, own: f64) -> f64 {
        match self {
            UnitScale::Linear { factor, offset } => own * factor + offset,
            UnitScale::Mired => 1e6 / own,
        }
    }

    fn own(self, amount: f64) -> f64 {
        match self {
            UnitScale::Linear { factor, offset } => (amount - offset) / factor,
            UnitScale::Mired => 1e6 / amount,
        }
    }
}

impl SettableLevels {
    /// Returns the levels of a setting. The class has numbers of the unit `unit`, in multiples of
    /// `step`; `own_unit` is the unit of the device's own numbers, and `options` the PDDL type of
    /// the levels.
    ///
    /// # Errors
    ///
    /// Returns the reason, which completes “its … cannot be set: ”, if the setting has no usable
    /// bounds or a message cannot be made.
    pub(crate) fn of(
        setting: &LevelSetting,
        own_unit: &str,
        (unit, step): (&str, f64),
        options: &str,
    ) -> Result<SettableLevels, String> {
        let LevelSetting { min, max, .. } = *setting;
        let scale = UnitScale::of(setting.scale, own_unit, unit)?;
        let bounds = [scale.amount(min), scale.amount(max)];
        let is_possible = |amount: &f64| is_possible_level(*amount, unit);
        if !(min < max && bounds.iter().all(is_possible)) {
            return Err(format!("its bounds are {} and {}", told(min), told(max)));
        }
        let mut numbers = own_numbers(setting, scale, step);
        numbers.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        let mut levels: Vec<SettableLevel> = Vec::new();
        for (amount, own) in numbers {
            let amount = rounded(amount, DECIMALS);
            let name = level_name(options, amount);
            if levels.last().is_none_or(|last| last.name != name) {
                let message = setting.message.with(own)?;
                levels.push(SettableLevel { name, amount, own, message });
            }
        }
        let LevelSetting { stop, switches_on, .. } = setting;
        Ok(SettableLevels { levels, scale, stop: stop.clone(), switches_on: *switches_on })
    }

    /// Returns a level by the name of its object.
    pub(crate) fn by_name(&self, name: &str) -> Option<&SettableLevel> {
        self.levels.iter().find(|level| level.name == name)
    }

    /// Returns the number that a device reports, in the unit of the class. A number that is equal
    /// to that of a level, but for rounding, is the number of this level.
    pub(crate) fn amount_of(&self, own: f64) -> f64 {
        /// Share of the range within which a number counts as that of a level: a device with 255
        /// steps rounds by half a step.
        const ROUNDING: f64 = 0.002;
        let amount = self.scale.amount(own);
        let range = match (self.levels.first(), self.levels.last()) {
            (Some(first), Some(last)) => last.own - first.own,
            _ => 0.0,
        };
        let distance = |level: &&SettableLevel| (level.own - own).abs();
        let nearest =
            { self.levels.iter() }.min_by(|one, other| distance(one).total_cmp(&distance(other)));
        match nearest {
            Some(level) if distance(&level) <= range.abs() * ROUNDING => level.amount,
            _ => rounded(amount, 6),
        }
    }
}

/// Returns the weight of a level in the costs of actions: between 0 and 1, and greater for a
/// greater number. Of two levels that reach a goal, plans choose the one that changes less.
pub(crate) fn weight(amount: f64, unit: &str) -> f64 {
    let share = match unit {
        "%" => amount / 100.0,
        "°C" => (amount + 50.0) / 200.0,
        "K" => amount / 10_000.0,
        // Any number is possible.
        _ => 0.5 + 0.5 * amount / (amount.abs() + MIDDLE_NUMBER),
    };
    rounded(share.clamp(0.0, 1.0), 9)
}

/// Returns the numbers of the levels, in the unit of the class and in the device's own scale: all
/// that the device distinguishes if they are few, and otherwise the multiples of the class's step.
/// The step is enlarged until there are at most [`LEVELS_MAX`].
fn own_numbers(setting: &LevelSetting, scale: UnitScale, step: f64) -> Vec<(f64, f64)> {
    let LevelSetting { min, max, step: own_step, .. } = *setting;
    let own_step = own_step.filter(|step| step.is_finite() && *step > 0.0 && *step <= max - min);
    let exact = |own: f64| (scale.amount(own), own);
    if let Some(own_step) = own_step
        && ((max - min) / own_step + 1e-9).floor() < position(OWN_STEPS_MAX)
    {
        let numbers = (0..=OWN_STEPS_MAX).map(|number| min + own_step * position(number));
        return numbers.take_while(|own| *own <= max + own_step * 1e-6).map(exact).collect();
    }
    let (low, high) = (scale.amount(min), scale.amount(max));
    let (low, high) = (low.min(high), low.max(high));
    let step = enlarged(step, high - low);
    let first = (low / step).ceil();
    // The device rounds a percentage to its own steps; the level is the percentage that was meant.
    // Degrees are not rounded, because people compare them with what is measured.
    let is_nominal = !matches!(setting.scale, NumberScale::Unit);
    let snapped = |amount: f64| {
        let own = scale.own(amount);
        let own = own_step.map_or(own, |step| min + ((own - min) / step).round() * step);
        let own = rounded(own, 6).clamp(min, max);
        if is_nominal { (amount, own) } else { exact(own) }
    };
    let between = (0..LEVELS_MAX).map(|number| (first + position(number)) * step);
    let between = between.take_while(|amount| *amount <= high + step * 1e-6).map(snapped);
    let mut numbers: Vec<_> = between.collect();
    // Bounds in degrees that are no multiples of the step are levels, too.
    let is_beside = |own: &f64| {
        let amount = scale.amount(*own) / step;
        (amount - amount.round()).abs() > 1e-6
    };
    if !is_nominal || numbers.is_empty() {
        numbers.extend([min, max].into_iter().filter(is_beside).map(exact));
    }
    numbers
}

/// Returns a number as text for people, in few characters.
fn told(number: f64) -> String {
    if number.abs() < 1e6 { number.to_string() } else { format!("{number:e}") }
}

#[allow(clippy::cast_precision_loss, reason = "at most a hundred")]
fn position(number: usize) -> f64 {
    number as f64
}

/// Returns the step, enlarged in the series 1, 2, 5, 10 until the range has few enough levels.
fn enlarged(step: f64, range: f64) -> f64 {
    let mut step = if step.is_finite() && step > 0.0 { step } else { 1.0 };
    let factors = [2.0, 2.5, 2.0];
    // Two places are left for the bounds. The range is finite, so the loop ends.
    for factor in factors.iter().cycle() {
        if range / step + 1.0 <= position(LEVELS_MAX - 2) {
            break;
        }
        step *= factor;
    }
    step
}

/// Whether a device can be set to a number in this unit.
pub(crate) fn is_possible_level(amount: f64, unit: &str) -> bool {
    match unit {
        // The color temperatures of lamps, from candles to a blue sky. In a room, kelvins would
        // have other bounds.
        "K" => (500.0..=40_000.0).contains(&amount),
        unit => is_possible_value(amount, unit),
    }
}

fn rounded(number: f64, decimals: i32) -> f64 {
    let factor = 10_f64.powi(decimals);
    let rounded = (number * factor).round() / factor;
    // Negative zero would be another text.
    if rounded == 0.0 { 0.0 } else { rounded }
}

/// Returns the name of the object for a level: `percent-50`, `celsius-21-5`, `celsius-minus-5`.
fn level_name(options: &str, amount: f64) -> String {
    let sign = if amount < 0.0 { "minus-" } else { "" };
    format!("{options}-{sign}{}", amount.abs().to_string().replace('.', "-"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setting::NumberMessage;

    fn setting(min: f64, max: f64, step: Option<f64>, scale: NumberScale) -> LevelSetting {
        let message = NumberMessage::plain("t");
        LevelSetting { min, max, step, scale, ..LevelSetting::percent(message) }
    }

    fn levels(setting: &LevelSetting, unit: (&str, f64)) -> Vec<f64> {
        let levels = SettableLevels::of(setting, "", unit, "x").expect("it is usable");
        levels.levels.iter().map(|level| level.amount).collect()
    }

    const PERCENT: NumberScale = NumberScale::Percent { zero: 0.0, full: 100.0 };

    #[test]
    fn levels_follow_from_the_bounds_and_the_step() {
        let blind = levels(&setting(0.0, 100.0, None, PERCENT), ("%", 5.0));
        assert_eq!((blind.len(), blind[0], blind[10], blind[20]), (21, 0.0, 50.0, 100.0));
        let thermostat = setting(5.0, 30.0, Some(0.5), NumberScale::Unit);
        let thermostat = levels(&thermostat, ("°C", 0.5));
        assert_eq!((thermostat.len(), thermostat[0], thermostat[50]), (51, 5.0, 30.0));
        // A fan with three speeds has three levels.
        let speeds = NumberScale::Percent { zero: 0.0, full: 3.0 };
        let fan = levels(&setting(1.0, 3.0, Some(1.0), speeds), ("%", 5.0));
        assert_eq!(fan, [33.333, 66.667, 100.0]);
        // A bulb from 153 to 500 mireds; the bounds are no multiples of 250 K.
        let bulb = levels(&setting(153.0, 500.0, Some(1.0), NumberScale::Mired), ("K", 250.0));
        assert_eq!((bulb.len(), bulb[0], bulb[18]), (19, 2000.0, 6500.0));
        // A thermostat in °F: the bounds are levels, too.
        let fahrenheit =
            LevelSetting { scale: NumberScale::Unit, ..setting(45.0, 95.0, Some(1.0), PERCENT) };
        let found = SettableLevels::of(&fahrenheit, "°F", ("°C", 0.5), "celsius").expect("usable");
        assert_eq!((found.levels.len(), found.levels[0].amount), (51, 7.222));
    }

    #[test]
    fn a_reported_number_near_a_level_is_this_level() {
        let brightness = NumberScale::Percent { zero: 0.0, full: 254.0 };
        let levels = SettableLevels::of(
            &setting(1.0, 254.0, Some(1.0), brightness),
            "",
            ("%", 5.0),
            "percent",
        );
        let levels = levels.expect("it is usable");
        let half = levels.by_name("percent-50").expect("a level");
        assert_eq!(half.message.text, "127");
        let lowest = levels.by_name("percent-5").expect("a level");
        assert_eq!(lowest.message.text, "13");
        for (own, expected) in [(127.0, 50.0), (254.0, 100.0), (0.0, 0.0)] {
            assert_eq!(levels.amount_of(own), expected, "{own}");
        }
        for level in &levels.levels {
            assert_eq!(levels.amount_of(level.own), level.amount, "{level:?}");
        }
    }

    #[test]
    fn hostile_bounds_are_refused_and_their_number_is_limited() {
        for (min, max, unit) in [
            (f64::NAN, 100.0, "%"),
            (0.0, f64::NAN, "%"),
            (0.0, f64::INFINITY, ""),
            (-1e308, 1e308, ""),
            (1e308, 1e308, ""),
            (100.0, 0.0, "%"),
            (0.0, 0.0, "%"),
            (-500.0, 30.0, "°C"),
            (5.0, 1e9, "°C"),
        ] {
            let setting = setting(min, max, Some(1.0), NumberScale::Unit);
            let found = SettableLevels::of(&setting, "", (unit, 1.0), "x");
            assert!(found.is_err(), "{min} {max}: {found:?}");
        }
        for zero_and_full in [(0.0, 0.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
            let (zero, full) = zero_and_full;
            let setting = setting(0.0, 1.0, None, NumberScale::Percent { zero, full });
            assert!(SettableLevels::of(&setting, "", ("%", 5.0), "x").is_err());
        }
        for (min, max, step) in [
            (0.0, 100.0, Some(0.0)),
            (0.0, 100.0, Some(-1.0)),
            (0.0, 100.0, Some(f64::NAN)),
            (0.0, 100.0, Some(1e-300)),
            (0.0, 100.0, Some(1e308)),
            (0.0, 1e6, Some(1.0)),
            (-1e12, 1e12, Some(1e-6)),
            (0.0, 1e-9, None),
            (21.25, 21.75, Some(0.5)),
        ] {
            let levels = levels(&setting(min, max, step, NumberScale::Unit), ("", 1.0));
            assert!((1..=LEVELS_MAX).contains(&levels.len()), "{min} {max} {step:?}: {levels:?}");
            assert!(levels.is_sorted_by(|one, other| one < other), "{levels:?}");
        }
    }

    #[test]
    fn a_level_is_named_by_its_number() {
        for (amount, expected) in [
            (50.0, "percent-50"),
            (21.5, "percent-21-5"),
            (-5.0, "percent-minus-5"),
            (0.0, "percent-0"),
            (1e12, "percent-1000000000000"),
        ] {
            assert_eq!(level_name("percent", amount), expected);
        }
    }

    #[test]
    fn a_greater_level_weighs_more() {
        for unit in ["%", "°C", "K", ""] {
            let weights = [1.0, 20.0, 21.0, 90.0].map(|amount| weight(amount, unit));
            assert!(weights.is_sorted_by(|one, other| one < other), "{unit}: {weights:?}");
            assert!(weights.iter().all(|weight| (0.0..=1.0).contains(weight)), "{weights:?}");
        }
    }
}
