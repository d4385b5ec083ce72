//! The command driver, which switches a device by running a program.
//!
//! - The crate `programs` runs programs, and ends each program with all processes that it has
//!   started.
//! - If the entry has a program that prints the state, only the output of this program determines
//!   the state. Otherwise the device counts as switched if the switching program has succeeded.

use std::sync::Arc;
use std::time::Duration;

use actuator::BoxFuture;
use programs::Program;
use tokio::time::Instant;

use crate::config::CommandConfig;
use crate::{Driver, words};

/// Pause between two checks of the state after switching. Several checks are needed because motors
/// take time.
const CHECK_INTERVAL: Duration = Duration::from_millis(200);

/// Texts that mean on, and texts that mean off.
const ON: [&str; 6] = ["on", "1", "true", "yes", "locked", "active"];
const OFF: [&str; 6] = ["off", "0", "false", "no", "unlocked", "inactive"];

/// Maximum number of characters of a program's output that are quoted.
const QUOTED_CHARS: usize = 60;

#[derive(Clone)]
struct CommandDriver(Arc<CommandConfig>);

pub(crate) fn driver(commanded: CommandConfig) -> Arc<dyn Driver> {
    Arc::new(CommandDriver(Arc::new(commanded)))
}

impl CommandDriver {
    /// Runs the program that prints the state. Returns `true` if the device is on.
    async fn read_program(&self, state: &Program) -> Result<bool, String> {
        let printed = state.run(self.0.time_out).await.map_err(|error| error.to_string())?;
        let word = printed.trim();
        is_on(word).ok_or_else(|| {
            let told: String = word.chars().take(QUOTED_CHARS).collect();
            format!("read on or off from what `{}` prints: {told}", state.name())
        })
    }

    async fn switch_to(&self, wanted: bool) -> Result<bool, String> {
        let CommandConfig { on, off, state, time_out, .. } = &*self.0;
        let program = if wanted { on } else { off };
        program.run(*time_out).await.map_err(|error| error.to_string())?;
        let Some(state) = state else { return Ok(wanted) };
        let began = Instant::now();
        loop {
            let told = self.read_program(state).await?;
            if told == wanted {
                return Ok(told);
            }
            if began.elapsed() + CHECK_INTERVAL > *time_out {
                let (name, told) = (state.name(), words(told));
                return Err(format!("switch it {}: `{name}` says {told}", words(wanted)));
            }
            tokio::time::sleep(CHECK_INTERVAL).await;
        }
    }
}

/// Returns `true` if a text means on and `false` if it means off; `None` for any other text.
fn is_on(word: &str) -> Option<bool> {
    let is_in = |words: [&str; 6]| words.iter().any(|known| known.eq_ignore_ascii_case(word));
    if is_in(ON) { Some(true) } else { is_in(OFF).then_some(false) }
}

impl Driver for CommandDriver {
    fn switch(&self, is_on: bool) -> BoxFuture<Result<bool, String>> {
        let command = self.clone();
        Box::pin(async move { command.switch_to(is_on).await })
    }

    fn read_state(&self) -> BoxFuture<Result<Option<bool>, String>> {
        let command = self.clone();
        Box::pin(async move {
            match &command.0.state {
                Some(state) => command.read_program(state).await.map(Some),
                None => Ok(None),
            }
        })
    }

    fn every(&self) -> Option<Duration> {
        self.0.state.as_ref().map(|_| self.0.every)
    }

    fn time_out(&self) -> Duration {
        // The program runs first, then the state is checked; the last check may begin just before
        // the time limit.
        self.0.time_out * if self.0.state.is_some() { 3 } else { 1 }
    }
}

#[cfg(test)]
mod tests {
    use actuator::Device as _;
    use serde_json::{Value, json};
    use tempfile::TempDir;

    use super::*;
    use crate::tests::{blueprint, facts, offers, switch, told, until};
    use crate::{REST_AFTER_FAILURE, Switch};

    fn script(text: &str) -> Value {
        json!(["/bin/sh", "-c", text])
    }

    async fn lamp(on: &str, more: Value) -> Switch {
        let mut config = json!({ "location": "lab", "kind": "lamp", "on": script(on) });
        config["off"] = script("true");
        config["time-out"] = json!("2s");
        if let (Value::Object(config), Value::Object(more)) = (&mut config, more) {
            config.extend(more);
        }
        let lamp = crate::switch(&blueprint("command", config)).expect("a switch");
        if let Some(look) = lamp.read_state() {
            look.await;
        }
        lamp
    }

    /// Returns a lamp with its state in a file.
    async fn filed(folder: &TempDir, on: &str) -> Switch {
        let file = folder.path().join("lamp");
        std::fs::write(&file, "off\n").expect("a file");
        let file = file.display();
        let more = json!({
            "off": script(&format!("echo OFF > {file}")),
            "state": ["cat", file.to_string()],
            "every": "100ms",
        });
        lamp(&on.replace("FILE", &file.to_string()), more).await
    }

    fn lamp_is(state: Option<bool>) -> String {
        told("lamp-on", state)
    }

    #[tokio::test]
    async fn without_a_state_program_a_successful_switch_counts() {
        let mut lamp = lamp("true", json!({})).await;
        assert_eq!((offers(&lamp), facts(&lamp).as_str()), (2, lamp_is(None).as_str()));
        assert!(lamp.next_event().is_none(), "nothing happens by itself");
        assert_eq!(switch(&mut lamp, "on").await.as_deref(), Ok("on at lab"));
        assert_eq!(facts(&lamp), lamp_is(Some(true)));
        assert_eq!(switch(&mut lamp, "off").await.as_deref(), Ok("off at lab"));
        assert_eq!(facts(&lamp), lamp_is(Some(false)));
    }

    #[tokio::test]
    async fn the_output_of_the_state_program_becomes_facts() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut lamp = filed(&folder, "(sleep 0.5; echo 1 > FILE)").await;
        assert_eq!(switch(&mut lamp, "on").await.as_deref(), Ok("on at lab"));
        assert_eq!(facts(&lamp), lamp_is(Some(true)));
        std::fs::write(folder.path().join("lamp"), "False").expect("a file");
        until(&mut lamp, |lamp| facts(lamp) == lamp_is(Some(false))).await;
        std::fs::write(folder.path().join("lamp"), "LOCKED\n").expect("a file");
        until(&mut lamp, |lamp| facts(lamp) == lamp_is(Some(true))).await;
        // A switch with an unreadable state is unavailable until its state can be read again.
        std::fs::write(folder.path().join("lamp"), "who knows").expect("a file");
        until(&mut lamp, |lamp| offers(lamp) == 0).await;
        assert_eq!(facts(&lamp), lamp_is(None));
        std::fs::write(folder.path().join("lamp"), "on").expect("a file");
        until(&mut lamp, |lamp| offers(lamp) == 2).await;
        assert_eq!(facts(&lamp), lamp_is(Some(true)));
    }

    #[tokio::test]
    async fn a_program_without_effect_has_not_switched() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut lamp = filed(&folder, "true").await;
        let problem = switch(&mut lamp, "on").await.expect_err("nothing was switched");
        assert_eq!(problem, "switch it on: `cat` says off");
        assert_eq!(facts(&lamp), lamp_is(None));
    }

    #[tokio::test]
    async fn a_failing_hanging_or_flooding_program_pauses_the_switch() {
        for (on, expected) in [
            ("echo trying >&2; echo no bulb >&2; exit 3", "run `/bin/sh`: exit status: 3: no bulb"),
            ("sleep 600 & wait", "wait for `/bin/sh`: it did not end within 2s and was killed"),
            ("yes", "read the output of `/bin/sh`: it prints more than 64 KiB"),
            ("kill -9 $$", "run `/bin/sh`: signal: 9 (SIGKILL)"),
        ] {
            let mut lamp = lamp(on, json!({})).await;
            assert_eq!(switch(&mut lamp, "off").await.as_deref(), Ok("off at lab"));
            assert_eq!(switch(&mut lamp, "on").await.expect_err(on), expected);
            assert_eq!((offers(&lamp), facts(&lamp).as_str()), (0, lamp_is(None).as_str()), "{on}");
        }
    }

    #[tokio::test]
    async fn a_failed_switch_offers_its_actions_again_after_the_pause() {
        let mut lamp = lamp("exit 1", json!({})).await;
        assert!(switch(&mut lamp, "on").await.is_err());
        assert_eq!(offers(&lamp), 0);
        let until = lamp.paused_until.expect("it rests");
        let rests = until.saturating_duration_since(Instant::now());
        assert!(rests <= REST_AFTER_FAILURE && rests > REST_AFTER_FAILURE / 2, "{rests:?}");
        lamp.paused_until = Some(Instant::now());
        assert_eq!(offers(&lamp), 2);
    }

    #[tokio::test]
    async fn a_state_read_before_switching_is_discarded() {
        let state = script("sleep 0.5; echo off");
        let mut lamp = lamp("true", json!({ "state": state, "every": "100ms" })).await;
        let looking = tokio::spawn(lamp.driver_handle.clone().refresh());
        tokio::time::sleep(Duration::from_millis(100)).await;
        let switching = tokio::spawn(lamp.driver_handle.clone().switch(true));
        looking.await.expect("it looks");
        assert_eq!(lamp.driver_handle.state(), Ok(Some(false)), "as it was at first");
        assert!(switching.await.expect("it switches").is_err(), "it says off for ever");
        lamp.on_failure(&crate::tests::call("on"), &actuator::MethodFailure::GivenUp);
        assert_eq!(lamp.driver_handle.state(), Ok(None));
        assert_eq!(offers(&lamp), 2, "who was given up has not failed");
    }

    #[test]
    fn texts_for_on_and_off_are_parsed() {
        for (word, expected) in [
            ("on", Some(true)),
            ("1", Some(true)),
            ("TRUE", Some(true)),
            ("LOCKED", Some(true)),
            ("Off", Some(false)),
            ("0", Some(false)),
            ("false", Some(false)),
            ("UNLOCKED", Some(false)),
            ("", None),
            ("JAMMED", None),
            ("on off", None),
        ] {
            assert_eq!(is_on(word), expected, "{word}");
        }
    }
}
