//! `althing sensors`: shows the sensors of this machine, and the lines that add them to an
//! ecosystem file.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::process::ExitCode;

use linux_sensors::{ReadError, SensorBundle, SensorChannel, Sysfs, SysfsQuantity};
use pddl::{Diagnostic, Span};
use serde_json::json;
use terminal::report::{DiagnosticReport, reason};
use terminal::{exit, output};

use crate::cli::SensorsArgs;

/// Runs `althing sensors`: shows the sensors of this machine.
pub(crate) fn run(args: &SensorsArgs) -> ExitCode {
    if let Err(error) = std::fs::read_dir(&args.sysfs) {
        let sysfs = args.sysfs.display();
        let mut report = DiagnosticReport::default();
        report.add_general(Diagnostic::error(
            Span::default(),
            format!("failed to look into {sysfs}: {}", reason(&error)),
        ));
        return output::show(&report, args.print.json, "bad-input", exit::BAD_INPUT);
    }
    let channels = Sysfs::new(&args.sysfs).channels();
    if args.print.json {
        return output::print_json(
            &json!(channels.iter().map(told).collect::<Vec<_>>()),
            exit::DONE,
        );
    }
    if args.toml {
        return output::print(lines(&channels), exit::DONE);
    }
    if channels.is_empty() {
        let sysfs = args.sysfs.display();
        let none = format!(
            "the kernel of this machine knows no sensor ({sysfs})\nalthing help sensors says more\n"
        );
        return output::print(none, exit::DONE);
    }
    output::print(table(&channels), exit::DONE)
}

fn told(channel: &SensorChannel) -> serde_json::Value {
    let mut told = json!(channel);
    told["unit"] = json!(channel.quantity.unit());
    match channel.read() {
        Ok(value) => told["value"] = json!(value),
        Err(error) => told["problem"] = json!(format!("failed to {error}")),
    }
    told
}

fn table(channels: &[SensorChannel]) -> String {
    let width = channels.iter().map(|each| each.device.to_string().len()).max().unwrap_or(0);
    let mut text = String::new();
    for channel in channels {
        let SensorChannel { device, quantity, is_ambient, .. } = channel;
        let now = match channel.read() {
            Ok(value) => format!("{value:.1} {}", quantity.unit()),
            // `--json` shows the path of the file.
            Err(ReadError::File { source, .. }) => format!("fails: {source}"),
            Err(error) => format!("failed to {error}"),
        };
        let inside = if *is_ambient { "" } else { " (of the machine itself)" };
        let device = device.to_string();
        let _ = writeln!(text, "{device:<width$}  {quantity:<11}  {now}{inside}");
    }
    text + "\nalthing sensors --toml prints the lines that bring them into an ecosystem\n"
}

/// Returns lines for an ecosystem file: the entry of one agent for each device and quantity.
/// Sensors that measure the machine itself are left out.
fn lines(channels: &[SensorChannel]) -> String {
    let mut counts = BTreeMap::new();
    let mut text = String::new();
    for bundle in SensorBundle::all(channels) {
        let count: &mut u32 = counts.entry(bundle.quantity).or_default();
        *count += 1;
        text += &entry(&bundle, *count);
    }
    text
}

/// Returns the entry of the agent of one sensor, without its room.
pub(super) fn entry(bundle: &SensorBundle, number: u32) -> String {
    let SensorBundle { device, quantity, channel, has_humidity } = bundle;
    let is_thermometer = *quantity == SysfsQuantity::Temperature;
    let plugin = if is_thermometer { "temperature-sensor" } else { "sensor" };
    let mut text = format!(
        "[[agent]]\nname = \"{quantity}-{number}\"\nplugin = \"{plugin}\"\ndriver = \"linux\"\n\n\
         [agent.config]\nlocation = \"\"        # the room it stands in\n\
         device = \"{device}\"\n"
    );
    if let Some(channel) = channel {
        let _ = writeln!(text, "channel = \"{channel}\"");
    }
    if !is_thermometer {
        let _ = writeln!(text, "quantity = \"{quantity}\"");
    } else if *has_humidity {
        let _ = writeln!(text, "humidity = true");
    }
    text + "\n"
}
