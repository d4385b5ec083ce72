//! The GPIO driver, which switches a relay on a line of a board. The state of the relay is read
//! back from the line.

use std::sync::Arc;
use std::time::Duration;

use actuator::BoxFuture;
use gpio_lines::{DrivenOutput, GpioBoard, GpioChips};

use crate::config::GpioConfig;
use crate::{Driver, words};

/// Pause between two checks whether the GPIO chip is plugged in: about the time that a person needs
/// to plug it in.
const PRESENCE_CHECK_INTERVAL: Duration = Duration::from_secs(1);

/// Time limit for switching a line on a slow bus.
const SWITCHING_TIME_MAX: Duration = Duration::from_secs(2);

struct GpioRelay {
    output: DrivenOutput,
    name: String,
}

pub(crate) fn driver(GpioConfig { output, chips }: GpioConfig) -> Arc<dyn Driver> {
    let chips = chips.map_or_else(GpioChips::default, GpioChips::new);
    on(Arc::new(chips), output)
}

/// Returns the driver for a line of the board `board`.
fn on(board: Arc<dyn GpioBoard>, output: gpio_lines::OutputSettings) -> Arc<dyn Driver> {
    let name = output.line.to_string();
    Arc::new(GpioRelay { output: DrivenOutput::new(board, output), name })
}

impl Driver for GpioRelay {
    fn switch(&self, is_on: bool) -> BoxFuture<Result<bool, String>> {
        let (driven, name) = (self.output.clone(), self.name.clone());
        Box::pin(async move {
            let found = driven.set(is_on).await?;
            if found == is_on {
                return Ok(found);
            }
            // A stronger signal fixes the level of the line, such as a short circuit or another
            // driver.
            Err(format!("switch the line `{name}` {}: it stays {}", words(is_on), words(found)))
        })
    }

    fn read_state(&self) -> BoxFuture<Result<Option<bool>, String>> {
        let driven = self.output.clone();
        Box::pin(async move { driven.value().await.map(Some) })
    }

    fn every(&self) -> Option<Duration> {
        Some(PRESENCE_CHECK_INTERVAL)
    }

    fn time_out(&self) -> Duration {
        SWITCHING_TIME_MAX
    }
}

#[cfg(test)]
mod tests {
    use actuator::Device as _;
    use gpio_lines::{MemoryBoard, OutputSettings};
    use serde_json::json;

    use super::*;
    use crate::tests::{blueprint, facts, offers, switch, told, until};
    use crate::{DriverHandle, Switch};

    /// Returns a relay on a simulated board.
    async fn relay(bench: &MemoryBoard, is_active_low: bool) -> Switch {
        let config = json!({ "location": "lab", "kind": "relay", "line": "GPIO4" });
        let mut relay = crate::switch(&blueprint("gpio", config)).expect("a switch");
        let line = "GPIO4".to_owned().try_into().expect("a name");
        relay.driver_handle =
            DriverHandle::of(on(Arc::new(bench.clone()), OutputSettings { line, is_active_low }));
        relay.read_state().expect("it may be away").await;
        relay
    }

    fn relay_is(state: Option<bool>) -> String {
        told("relay-on", state)
    }

    #[tokio::test]
    async fn a_relay_keeps_its_state_until_it_is_switched() {
        for is_active_low in [false, true] {
            let bench = MemoryBoard::default();
            bench.plug("GPIO4", true);
            let mut relay = relay(&bench, is_active_low).await;
            let powered = relay_is(Some(true));
            let not_powered = relay_is(Some(false));
            let at_first = if is_active_low { &not_powered } else { &powered };
            assert_eq!(facts(&relay), *at_first);
            assert_eq!(bench.level("GPIO4"), Some(true), "nothing switched");
            assert_eq!(switch(&mut relay, "off").await.as_deref(), Ok("off at lab"));
            assert_eq!(facts(&relay), not_powered);
            assert_eq!(switch(&mut relay, "on").await.as_deref(), Ok("on at lab"));
            assert_eq!(facts(&relay), powered);
            assert_eq!(bench.level("GPIO4"), Some(!is_active_low));
        }
    }

    #[tokio::test]
    async fn an_unplugged_chip_makes_its_agent_unavailable_until_it_is_back() {
        let bench = MemoryBoard::default();
        let mut relay = relay(&bench, false).await;
        assert_eq!((offers(&relay), facts(&relay).as_str()), (0, relay_is(None).as_str()));
        bench.plug("GPIO4", true);
        until(&mut relay, |relay| offers(relay) == 2).await;
        assert_eq!(facts(&relay), relay_is(Some(true)));
        bench.unplug("GPIO4");
        until(&mut relay, |relay| offers(relay) == 0).await;
        assert_eq!(facts(&relay), relay_is(None), "nobody knows");
        let problem = switch(&mut relay, "on").await.expect_err("it is away");
        assert!(problem.starts_with("find a line named `GPIO4`; "), "{problem}");
        bench.plug("GPIO4", false);
        until(&mut relay, |relay| offers(relay) == 2).await;
        assert_eq!(switch(&mut relay, "on").await.as_deref(), Ok("on at lab"));
    }

    #[tokio::test]
    async fn a_line_held_by_a_stronger_signal_has_not_switched() {
        let bench = MemoryBoard::default();
        bench.plug("GPIO4", false);
        bench.fix_level("GPIO4");
        let mut relay = relay(&bench, false).await;
        let problem = switch(&mut relay, "on").await.expect_err("it is held");
        assert_eq!(problem, "switch the line `GPIO4` on: it stays off");
        assert_eq!(
            (offers(&relay), facts(&relay).as_str()),
            (0, relay_is(None).as_str()),
            "it rests"
        );
    }
}
