//! The command driver, which measures by running a program and parsing its output.
//!
//! - The crate `programs` runs and ends programs.
//! - A quantity that is announced when it changes (motion) is measured by running its program
//!   repeatedly.

use std::sync::Arc;
use std::time::Duration;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError, config_duration};
use programs::Program;
use tokio::time::Instant;

use crate::config::HardwareConfig;
use crate::quantity::{SensorQuantity, is_yes};
use crate::text::{self, FoundValue, TextFormat};
use crate::{MEASURING, Measurement, Probe};

/// Default pause between two runs of the program for a quantity that is announced when it changes.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// Minimum and maximum of that pause. Without one, a core would only start programs.
const EVERY_MIN: Duration = Duration::from_millis(10);
const EVERY_MAX: Duration = Duration::from_hours(24);

/// Time limit of a program. It is shorter than that of the method, so that the program's error is
/// reported.
const RUNNING: Duration = Duration::from_millis(1_900);
const _: () = assert!(RUNNING.as_millis() < MEASURING.as_millis());

#[derive(Clone)]
struct CommandProbe {
    program: Program,
    /// Format of the value in the output of the program.
    format: TextFormat,
    every: Duration,
}

pub(crate) fn probe(
    blueprint: &Blueprint,
    mut hardware: HardwareConfig,
    quantities: &[&SensorQuantity],
) -> Result<Arc<dyn Probe>, BuildError> {
    let missing = || {
        blueprint.problem(
            "driver `command` needs a `command`: a program and its arguments, such as \
             command = [\"cat\", \"/run/temperature\"]",
        )
    };
    let format = hardware.text_format(blueprint, quantities);
    let HardwareConfig { command, every, .. } = hardware;
    let program = Program::of(command.into_iter().flatten()).ok_or_else(missing)?;
    let format = format?;
    let period = |text: &str| config_duration("every", text, EVERY_MIN..=EVERY_MAX);
    let every = every.as_deref().map(period).transpose();
    let every = every.map_err(|problem| blueprint.problem(problem))?.unwrap_or(LOOK_AGAIN);
    Ok(Arc::new(CommandProbe { program, format, every }))
}

impl CommandProbe {
    async fn measure_once(&self, quantity: &str) -> Result<f64, String> {
        let name = self.program.name();
        let printed = self.program.run(RUNNING).await.map_err(|error| error.to_string())?;
        let printed = printed.trim();
        let said = match &self.format.pointer {
            None => FoundValue { word: printed.to_owned(), unit: None },
            Some(pointer) => text::at(printed, pointer, quantity).ok_or_else(|| {
                format!("find {pointer} in what `{name}` prints: {}", text::excerpt(printed))
            })?,
        };
        let quantity = SensorQuantity::named(quantity)?;
        let wanted = if quantity.is_noticed() { "yes or no" } else { "a number" };
        self.format
            .value(&said, quantity)
            .map_err(|problem| format!("read {wanted} from what `{name}` prints: {problem}"))
    }
}

impl Probe for CommandProbe {
    fn measure(&self, quantity: &'static str) -> BoxFuture<Result<Measurement, String>> {
        let command = self.clone();
        Box::pin(async move {
            let value = command.measure_once(quantity).await?;
            Ok(Measurement { value, at: Instant::now() })
        })
    }

    fn notice(&self, quantity: &'static str, known: f64) -> BoxFuture<Result<Measurement, String>> {
        let command = self.clone();
        Box::pin(async move {
            loop {
                let value = command.measure_once(quantity).await?;
                if is_yes(value) != is_yes(known) {
                    return Ok(Measurement { value, at: Instant::now() });
                }
                tokio::time::sleep(command.every).await;
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::tests::{blueprint_with, facts, measure};
    use crate::{sensor, temperature_sensor};

    fn config(command: &[&str], more: Value) -> Value {
        let mut config = json!({ "location": "lab", "command": command });
        if let (Value::Object(config), Value::Object(more)) = (&mut config, more) {
            config.extend(more);
        }
        config
    }

    async fn measured(command: &[&str], more: Value) -> Result<String, String> {
        let blueprint = blueprint_with("command", config(command, more));
        let mut sensor = temperature_sensor(&blueprint).map_err(|error| error.to_string())?;
        let performed = measure(&mut sensor, "temperature").await;
        performed.map(|performed| performed.detail).map_err(|failure| failure.to_string())
    }

    #[tokio::test]
    async fn the_output_of_a_program_is_the_measured_value() {
        let weather = r#"{"main": {"temp": 288.65, "words": "12.5"}}"#;
        for (command, more, expected) in [
            (&["echo", "21.5"][..], json!({}), "21.5 °C at lab"),
            (&["echo", "48312"], json!({ "factor": 0.001 }), "48.3 °C at lab"),
            (&["echo", weather], json!({ "json": "/main/temp", "unit": "K" }), "15.5 °C at lab"),
            (&["echo", "68 °F"], json!({}), "20.0 °C at lab"),
            (&["echo", "68"], json!({ "unit": "°F" }), "20.0 °C at lab"),
            (&["echo", weather], json!({ "json": "/main/words" }), "12.5 °C at lab"),
            // There is no shell that would interpret the arguments.
            (&["printf", "%s", "7.25"], json!({}), "7.2 °C at lab"),
        ] {
            assert_eq!(measured(command, more).await.as_deref(), Ok(expected), "{command:?}");
        }
    }

    #[tokio::test]
    async fn every_failure_of_a_program_is_reported() {
        let weather = r#"{"main": {"temp": 288.65}}"#;
        for (command, more, expected) in [
            (&["echo", "$HOME"][..], json!({}), "read a number from what `echo` prints: $HOME"),
            (&["echo", "nan"], json!({}), "read a number from what `echo` prints: nan"),
            (&["true"], json!({}), "read a number from what `true` prints: "),
            (&["echo", "on"], json!({}), "read a number from what `echo` prints: on"),
            (&["echo", "closed"], json!({}), "read a number from what `echo` prints: closed"),
            (
                &["echo", "999"],
                json!({}),
                "read a number from what `echo` prints: 999, which is impossible in °C",
            ),
            (
                &["echo", "1e305"],
                json!({}),
                "read a number from what `echo` prints: 1e305, which is impossible in °C",
            ),
            (
                &["echo", weather],
                json!({ "json": "/main/temp" }),
                "288.65, which is impossible in °C",
            ),
            (&["echo"], json!({ "unit": "hPa" }), "unit = \"hPa\": it cannot be converted to °C"),
            (
                &["echo"],
                json!({ "unit": "F", "factor": 2 }),
                "`factor` converts the number already: write `factor` or `unit`",
            ),
            (&["echo", "{}"], json!({ "json": "/a" }), "find /a in what `echo` prints: {}"),
            (&["/no/such/program"], json!({}), "run `/no/such/program`: No such file or directory"),
            (
                &["sh", "-c", "echo it is broken >&2; exit 3"],
                json!({}),
                "run `sh`: exit status: 3: it is broken",
            ),
            (&[], json!({}), "driver `command` needs a `command`: a program and its arguments"),
            (&["echo"], json!({ "json": "temp" }), "json = \"temp\": write a JSON pointer"),
            (&["echo"], json!({ "factor": 0 }), "factor = 0: write a finite number other than 0"),
            (&["echo"], json!({ "every": "often" }), "every `often`: expected number at 0"),
        ] {
            let problem = measured(command, more).await.expect_err(expected);
            assert!(problem.contains(expected), "{problem} is not {expected}");
        }
    }

    #[tokio::test]
    async fn a_hanging_program_fails_before_the_method_times_out() {
        let problem = measured(&["sleep", "600"], json!({})).await.expect_err("it hangs");
        assert_eq!(problem, "wait for `sleep`: it did not end within 1.9s and was killed");
    }

    #[tokio::test]
    async fn motion_is_reported() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("motion");
        std::fs::write(&file, "off\n").expect("a file");
        let path = file.display().to_string();
        let more = json!({ "quantity": "motion", "every": "20ms" });
        let blueprint = blueprint_with("command", config(&["cat", &path], more));
        let mut sensor = sensor(&blueprint).expect("a sensor");
        let watched = actuator::Device::next_event(&mut sensor).expect("it notices");
        std::fs::write(&file, "on\n").expect("a file");
        let stir = tokio::time::timeout(Duration::from_secs(20), watched).await.expect("in time");
        stir(&mut sensor);
        assert!(facts(&sensor).contains("(motion lab)"), "{}", facts(&sensor));
    }
}
