//! The command driver: measures by running a program, any program, and reading what it prints.
//!
//! - No shell: the program and its arguments are what the entry says, letter by letter.
//! - It is killed when its time is over, or when nobody waits for it any more; what it prints beyond
//!   a bound is not read.
//! - A sensor that notices by itself (motion) runs its program again and again.

use std::io;
use std::process::Stdio;
use std::sync::Arc;
use std::time::Duration;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use tokio::io::{AsyncRead, AsyncReadExt as _};
use tokio::process::Command;
use tokio::time::Instant;

use crate::config::Hardware;
use crate::quantity::is_yes;
use crate::text;
use crate::{MEASURING, Measurement, Probe};

/// So much of what a program prints is read.
const OUTPUT_BYTES_MAX: usize = 64 << 10;

/// Pause between two looks of a sensor that notices by itself, where its entry does not say.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// How long a program may run: so that what it says is heard before the method's time is over.
const RUNNING: Duration = Duration::from_millis(1_900);
const _: () = assert!(RUNNING.as_millis() < MEASURING.as_millis());

#[derive(Clone)]
struct Program {
    program: String,
    arguments: Vec<String>,
    /// Where in a JSON text the value is.
    pointer: Option<String>,
    factor: f64,
    every: Duration,
}

pub(crate) fn probe(
    blueprint: &Blueprint,
    hardware: Hardware,
) -> Result<Arc<dyn Probe>, BuildError> {
    let missing = || {
        blueprint.problem(
            "driver `command` needs a `command`: a program and its arguments, such as \
             command = [\"cat\", \"/run/temperature\"]",
        )
    };
    let Hardware { command, json, factor, every, .. } = hardware;
    let mut command = command.into_iter().flatten();
    let program = command.next().filter(|program| !program.is_empty()).ok_or_else(missing)?;
    let factor = factor.unwrap_or(1.0);
    if !factor.is_finite() || factor == 0.0 {
        return Err(
            blueprint.problem(format!("factor = {factor} leaves nothing of what is measured"))
        );
    }
    let every = every.as_deref().map(humantime::parse_duration).transpose();
    let every = every.map_err(|error| blueprint.problem(format!("every: {error}")))?;
    let (arguments, every) = (command.collect(), every.unwrap_or(LOOK_AGAIN));
    Ok(Arc::new(Program { program, arguments, pointer: json, factor, every }))
}

impl Program {
    async fn measure_once(&self) -> Result<f64, String> {
        let running = tokio::time::timeout(RUNNING, self.printed());
        let printed = running.await.map_err(|_| {
            format!("hear from `{}` within {RUNNING:?}: it was ended", self.program)
        })??;
        let printed = printed.trim();
        let said = match &self.pointer {
            None => printed.to_owned(),
            Some(pointer) => text::at(printed, pointer).ok_or_else(|| {
                format!("find {pointer} in what `{}` prints: {}", self.program, text::told(printed))
            })?,
        };
        let value = text::value(&said).ok_or_else(|| {
            format!("take what `{}` prints for a measurement: {}", self.program, text::told(&said))
        })?;
        Ok(value * self.factor)
    }

    /// What it prints, if it ends well.
    async fn printed(&self) -> Result<String, String> {
        let failed = |what: &str, error: io::Error| format!("{what} `{}`: {error}", self.program);
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).stdin(Stdio::null()).stdout(Stdio::piped());
        // Whoever drops this future ends the program, and those it has started with it.
        command.stderr(Stdio::piped()).kill_on_drop(true).process_group(0);
        let mut child = command.spawn().map_err(|error| failed("run", error))?;
        let _group = child.id().map(Group);
        let (text, complaint) = tokio::join!(read(child.stdout.take()), read(child.stderr.take()));
        let text = text.map_err(|error| failed("read what is printed by", error))?;
        if text.len() >= OUTPUT_BYTES_MAX {
            let kilobytes = OUTPUT_BYTES_MAX >> 10;
            return Err(format!("read more than {kilobytes} KiB, which `{}` prints", self.program));
        }
        let status = child.wait().await.map_err(|error| failed("wait for", error))?;
        if !status.success() {
            let complaint = complaint.unwrap_or_default();
            let complaint = String::from_utf8_lossy(&complaint);
            let said = if complaint.trim().is_empty() { "" } else { ": " };
            return Err(format!(
                "run `{}`: {status}{said}{}",
                self.program,
                text::told(complaint.trim())
            ));
        }
        Ok(String::from_utf8_lossy(&text).into_owned())
    }
}

/// What comes through a pipe until it ends, or to the bound.
async fn read(pipe: Option<impl AsyncRead + Unpin>) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    if let Some(pipe) = pipe {
        pipe.take(OUTPUT_BYTES_MAX as u64).read_to_end(&mut bytes).await?;
    }
    Ok(bytes)
}

/// The processes of a program that is running; ended when it is dropped.
struct Group(u32);

impl Drop for Group {
    fn drop(&mut self) {
        if let Some(group) = i32::try_from(self.0).ok().and_then(rustix::process::Pid::from_raw) {
            // Nobody is left where all have ended.
            let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
        }
    }
}

impl Probe for Program {
    fn measure(&self, _quantity: &'static str) -> BoxFuture<Result<Measurement, String>> {
        let program = self.clone();
        Box::pin(async move {
            let value = program.measure_once().await?;
            Ok(Measurement { value, at: Instant::now() })
        })
    }

    fn notice(
        &self,
        _quantity: &'static str,
        known: f64,
    ) -> BoxFuture<Result<Measurement, String>> {
        let program = self.clone();
        Box::pin(async move {
            loop {
                let value = program.measure_once().await?;
                if is_yes(value) != is_yes(known) {
                    return Ok(Measurement { value, at: Instant::now() });
                }
                tokio::time::sleep(program.every).await;
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
    async fn what_a_program_prints_is_measured() {
        let weather = r#"{"main": {"temp": 288.65, "words": "12.5"}}"#;
        for (command, more, expected) in [
            (&["echo", "21.5"][..], json!({}), "21.5 °C at lab"),
            (&["echo", "48312"], json!({ "factor": 0.001 }), "48.3 °C at lab"),
            (&["echo", weather], json!({ "json": "/main/temp" }), "288.6 °C at lab"),
            (&["echo", weather], json!({ "json": "/main/words" }), "12.5 °C at lab"),
            // No shell reads it.
            (&["printf", "%s", "7.25"], json!({}), "7.2 °C at lab"),
        ] {
            assert_eq!(measured(command, more).await.as_deref(), Ok(expected), "{command:?}");
        }
    }

    #[tokio::test]
    async fn what_goes_wrong_is_told() {
        for (command, more, expected) in [
            (&["echo", "$HOME"][..], json!({}), "what `echo` prints for a measurement: $HOME"),
            (&["echo", "nan"], json!({}), "take what `echo` prints for a measurement: nan"),
            (&["true"], json!({}), "take what `true` prints for a measurement: "),
            (&["echo", "{}"], json!({ "json": "/a" }), "find /a in what `echo` prints: {}"),
            (&["/no/such/program"], json!({}), "run `/no/such/program`: No such file or directory"),
            (
                &["sh", "-c", "echo it is broken >&2; exit 3"],
                json!({}),
                "run `sh`: exit status: 3: it is broken",
            ),
            (&[], json!({}), "driver `command` needs a `command`: a program and its arguments"),
            (&["echo"], json!({ "json": "temp" }), "json = \"temp\": write where in the text"),
            (&["echo"], json!({ "factor": 0 }), "factor = 0 leaves nothing of what is measured"),
            (&["echo"], json!({ "every": "often" }), "every: expected number at 0"),
        ] {
            let problem = measured(command, more).await.expect_err(expected);
            assert!(problem.contains(expected), "{problem} is not {expected}");
        }
    }

    /// Whether a process of this id lives, and is no corpse.
    fn lives(pid: &str) -> bool {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        stat.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with('Z'))
    }

    #[tokio::test]
    async fn who_hangs_is_ended_with_all_it_has_started() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("pids");
        let script = format!("sleep 600 & echo $! > {0}; echo $$ >> {0}; wait", file.display());
        let problem = measured(&["sh", "-c", &script], json!({})).await.expect_err("it hangs");
        assert_eq!(problem, "hear from `sh` within 1.9s: it was ended");
        let pids = std::fs::read_to_string(&file).expect("it has begun");
        assert_eq!(pids.lines().count(), 2);
        let ended = async {
            while pids.lines().any(lives) {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        tokio::time::timeout(Duration::from_secs(5), ended).await.expect("both are ended");
    }

    #[tokio::test]
    async fn who_prints_without_end_is_read_to_a_bound() {
        let problem = measured(&["yes", "12"], json!({})).await.expect_err("it never ends");
        assert_eq!(problem, "read more than 64 KiB, which `yes` prints");
    }

    #[tokio::test]
    async fn motion_is_noticed() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("motion");
        std::fs::write(&file, "off\n").expect("a file");
        let path = file.display().to_string();
        let more = json!({ "quantity": "motion", "every": "20ms" });
        let blueprint = blueprint_with("command", config(&["cat", &path], more));
        let mut sensor = sensor(&blueprint).expect("a sensor");
        let watched = actuator::Device::watch(&mut sensor).expect("it notices");
        std::fs::write(&file, "on\n").expect("a file");
        let stir = tokio::time::timeout(Duration::from_secs(20), watched).await.expect("in time");
        stir(&mut sensor);
        assert!(facts(&sensor).contains("(motion lab)"), "{}", facts(&sensor));
    }
}
