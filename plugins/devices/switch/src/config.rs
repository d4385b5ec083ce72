//! The `config` of a switch's entry: the keys of all switches, and the keys of each driver.

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Duration;

use actuator::PlaceName;
use agent::{Blueprint, BuildError, config_duration};
use gpio_lines::{LineName, OutputSettings};
use programs::Program;
use serde::Deserialize;

use crate::kind::SwitchKind;
use crate::{COMMAND, DRIVERS, GPIO};

/// Default and limits of the time limit of a program. The maximum is enough for a garage door,
/// which takes half a minute.
const TIME_OUT: Duration = Duration::from_secs(5);
const TIME_OUTS: RangeInclusive<Duration> = Duration::from_millis(1)..=Duration::from_mins(2);

/// Default and limits of the pause between two checks of the state.
const EVERY: Duration = Duration::from_secs(10);
const PERIODS: RangeInclusive<Duration> = Duration::from_millis(100)..=Duration::from_hours(24);

/// The `config` of a switch's entry in the ecosystem file.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Config {
    /// Room of the switch.
    pub(crate) location: PlaceName,
    /// Kind of the switched device: `"lamp"`, `"relay"` or `"lock"`.
    pub(crate) kind: SwitchKind,
    /// Driver `gpio`: name of the line, such as `"gpiochip0/17"` or `"GPIO17"`.
    line: Option<LineName>,
    /// Driver `gpio`: whether a low level of the line means on.
    active_low: Option<bool>,
    /// Driver `gpio`: folder of the GPIO chips' device files; default is `/dev`.
    chips: Option<PathBuf>,
    /// Driver `command`: the program that switches on, and its arguments.
    on: Option<Vec<String>>,
    /// Driver `command`: the program that switches off, and its arguments.
    off: Option<Vec<String>>,
    /// Driver `command`: the program that prints whether the device is on, and its arguments.
    state: Option<Vec<String>>,
    /// Driver `command`: pause between two checks of the state, such as `"10s"`.
    every: Option<String>,
    /// Driver `command`: time limit of each program, such as `"5s"`.
    time_out: Option<String>,
}

/// The config of the driver `gpio`.
pub(crate) struct GpioConfig {
    pub(crate) output: OutputSettings,
    /// Folder of the GPIO chips' device files; `None` for the default.
    pub(crate) chips: Option<PathBuf>,
}

/// The config of the driver `command`.
#[derive(Debug)]
pub(crate) struct CommandConfig {
    pub(crate) on: Program,
    pub(crate) off: Program,
    pub(crate) state: Option<Program>,
    pub(crate) every: Duration,
    pub(crate) time_out: Duration,
}

impl Config {
    /// Returns an error if a key belongs to another driver than that of the entry.
    pub(crate) fn is_of(&self, blueprint: &Blueprint) -> Result<(), BuildError> {
        let said = [
            ("line", GPIO, self.line.is_some()),
            ("active-low", GPIO, self.active_low.is_some()),
            ("chips", GPIO, self.chips.is_some()),
            ("on", COMMAND, self.on.is_some()),
            ("off", COMMAND, self.off.is_some()),
            ("state", COMMAND, self.state.is_some()),
            ("every", COMMAND, self.every.is_some()),
            ("time-out", COMMAND, self.time_out.is_some()),
        ];
        let this = blueprint.driver.as_str();
        let mut written = said.iter().filter(|(.., is_said)| *is_said);
        let Some((key, driver, _)) = written.clone().find(|(_, driver, _)| *driver != this) else {
            return Ok(());
        };
        // If all keys are those of another driver, the driver is wrong, and not the keys.
        if DRIVERS.contains(&this) && written.all(|(_, driver, _)| *driver != this) {
            return Err(blueprint.problem(format!(
                "a switch with driver = \"{this}\" has no `{key}`: write driver = \"{driver}\" beside \
                 `plugin`"
            )));
        }
        let problem = format!("`{key}` is for `driver = \"{driver}\"`");
        Err(blueprint.problem(format!("{problem}, and this driver is `{this}`")))
    }

    pub(crate) fn wired(&mut self, blueprint: &Blueprint) -> Result<GpioConfig, BuildError> {
        let line = self.line.take().ok_or_else(|| {
            blueprint.problem(
                "driver `gpio` needs a `line`: its chip and number, such as \"gpiochip0/17\", or \
                 its own name, such as \"GPIO17\"; gpioinfo(1) lists those of a machine",
            )
        })?;
        let output = OutputSettings { line, is_active_low: self.active_low.unwrap_or(false) };
        Ok(GpioConfig { output, chips: self.chips.take() })
    }

    pub(crate) fn commanded(&mut self, blueprint: &Blueprint) -> Result<CommandConfig, BuildError> {
        let program = |key: &str, list: Option<Vec<String>>| {
            Program::of(list.into_iter().flatten()).ok_or_else(|| {
                let example = format!("{key} = [\"/usr/local/bin/lamp\", \"{key}\"]");
                let problem = format!("driver `command` needs a program for `{key}`");
                blueprint.problem(format!("{problem} and its arguments, such as {example}"))
            })
        };
        let (on, off) = (program("on", self.on.take())?, program("off", self.off.take())?);
        let state = self.state.take().map(|list| program("state", Some(list))).transpose()?;
        let duration = |key: &str, text: Option<String>, allowed| {
            let read = text.map(|text| config_duration(key, &text, allowed)).transpose();
            read.map_err(|problem| blueprint.problem(problem))
        };
        if state.is_none() && self.every.is_some() {
            return Err(blueprint.problem("`every` is the period of `state`; write `state` too"));
        }
        let every = duration("every", self.every.take(), PERIODS)?.unwrap_or(EVERY);
        let time_out = duration("time-out", self.time_out.take(), TIME_OUTS)?.unwrap_or(TIME_OUT);
        Ok(CommandConfig { on, off, state, every, time_out })
    }
}
