//! The GPIO driver, which watches a line of a board. A motion detector or a door's contact is
//! connected to the line.
//!
//! - The crate `gpio-lines` finds and watches lines, including when the chip is unplugged and
//!   plugged in again.
//! - The first value of a line is announced at once; after that, each change of the level is
//!   announced.
//! - If the line does not exist or is not accessible, the sensor is unavailable and offers no
//!   actions. The reason is logged, and is in the error of a measurement.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError, config_duration};
use gpio_lines::{GpioBoard, GpioChips, InputSettings, LineState, LineWatch, watch_line};
use tokio::sync::watch;
use tokio::time::Instant;

use crate::config::HardwareConfig;
use crate::quantity::{SensorQuantity, is_yes};
use crate::{MEASURING, Measurement, Probe};

/// Time limit for waiting for the line's first value.
const FIRST_STATE_TIME_MAX: Duration = Duration::from_millis(1_500);
const _: () = assert!(FIRST_STATE_TIME_MAX.as_millis() < MEASURING.as_millis());

/// Maximum debounce time; with a longer one, hardly any change would be detected.
const DEBOUNCE_MAX: Duration = Duration::from_secs(10);

#[derive(Clone)]
struct GpioProbe {
    board: Arc<dyn GpioBoard>,
    input: InputSettings,
    /// Watch on the line. It is created at the first use, so that no line is opened before the
    /// agent is active.
    line_watch: Arc<Mutex<Option<LineWatch>>>,
    /// State of the line that was reported last.
    last_reported: Arc<Mutex<LineState>>,
}

pub(crate) fn probe(
    blueprint: &Blueprint,
    hardware: HardwareConfig,
    quantities: &[&'static SensorQuantity],
) -> Result<Arc<dyn Probe>, BuildError> {
    let HardwareConfig { line, active_low, bias, debounce, chips, .. } = hardware;
    if let Some(number) = quantities.iter().find(|quantity| !quantity.is_noticed()) {
        let problem =
            "driver `gpio` measures what is yes or no: motion, reflection, contact; and no";
        return Err(blueprint.problem(format!("{problem} {}", number.name)));
    }
    let line = line.ok_or_else(|| {
        blueprint.problem(
            "driver `gpio` needs a `line`: its chip and number, such as \"gpiochip0/17\", or its \
             own name, such as \"GPIO17\"; gpioinfo(1) lists those of a machine",
        )
    })?;
    let stillness = |text: &str| config_duration("debounce", text, Duration::ZERO..=DEBOUNCE_MAX);
    let debounce = debounce.as_deref().map(stillness).transpose();
    let debounce = debounce.map_err(|problem| blueprint.problem(problem))?;
    let is_active_low = active_low.unwrap_or(false);
    let chips = chips.map_or_else(GpioChips::default, GpioChips::new);
    Ok(Arc::new(GpioProbe::new(
        Arc::new(chips),
        InputSettings { line, is_active_low, bias, debounce },
    )))
}

impl GpioProbe {
    fn new(board: Arc<dyn GpioBoard>, input: InputSettings) -> GpioProbe {
        let told = Arc::new(Mutex::new(LineState::Unknown));
        GpioProbe { board, input, line_watch: Arc::default(), last_reported: told }
    }

    fn state(&self) -> watch::Receiver<LineState> {
        let mut followed = lock(&self.line_watch);
        let make = || watch_line(Arc::clone(&self.board), self.input.clone());
        followed.get_or_insert_with(make).state()
    }

    /// Waits for the first check of the line, and returns the state of the line; `Unknown` after
    /// [`FIRST_STATE_TIME_MAX`].
    async fn first_state(&self) -> LineState {
        let mut state = self.state();
        let known = state.wait_for(|state| *state != LineState::Unknown);
        let known = tokio::time::timeout(FIRST_STATE_TIME_MAX, known).await;
        known.ok().and_then(Result::ok).map_or(LineState::Unknown, |state| state.clone())
    }
}

/// Returns the measurement for a state of the line; `None` if the line is unknown or unavailable.
fn measured(state: &LineState) -> Option<Measurement> {
    match state {
        LineState::Present(is_active) => {
            Some(Measurement { value: f64::from(*is_active), at: Instant::now() })
        }
        LineState::Unknown | LineState::Unavailable(_) => None,
    }
}

impl Probe for GpioProbe {
    fn measure(&self, _quantity: &'static str) -> BoxFuture<Result<Measurement, String>> {
        let gpio = self.clone();
        Box::pin(async move {
            let state = gpio.first_state().await;
            measured(&state).ok_or_else(|| match state {
                LineState::Unavailable(problem) => problem,
                _ => format!("read the line `{}` within {FIRST_STATE_TIME_MAX:?}", gpio.input.line),
            })
        })
    }

    fn notice(
        &self,
        _quantity: &'static str,
        known: f64,
    ) -> BoxFuture<Result<Measurement, String>> {
        let gpio = self.clone();
        Box::pin(async move {
            let mut state = gpio.state();
            loop {
                let measured = measured(&state.borrow_and_update());
                if let Some(measured) = measured.filter(|now| is_yes(now.value) != is_yes(known)) {
                    return Ok(measured);
                }
                state.changed().await.map_err(|_| "watch its line any more".to_owned())?;
            }
        })
    }

    fn is_present(&self) -> bool {
        // Before the line is watched, the sensor counts as present, because its full action model
        // is needed then.
        let state = lock(&self.line_watch).as_ref().map(LineWatch::state);
        state.is_none_or(|state| matches!(*state.borrow(), LineState::Present(_)))
    }

    fn check_presence(&self) -> Option<BoxFuture<()>> {
        let gpio = self.clone();
        Some(Box::pin(async move { drop(gpio.first_state().await) }))
    }

    fn wait_for_news(&self) -> Option<BoxFuture<()>> {
        let gpio = self.clone();
        Some(Box::pin(async move {
            let (told, mut state) = (lock(&gpio.last_reported).clone(), gpio.state());
            if let Ok(now) = state.wait_for(|state| *state != told).await
                && let LineState::Unavailable(problem) = &*now
            {
                tracing::warn!("failed to {problem}");
            }
        }))
    }

    fn last_report(&self, _quantity: &'static str) -> Option<Result<Measurement, String>> {
        let state = self.state().borrow().clone();
        let measured = measured(&state);
        *lock(&self.last_reported) = state;
        measured.map(Ok)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use actuator::Device as _;
    use gpio_lines::MemoryBoard;
    use serde_json::{Value, json};

    use super::*;
    use crate::tests::{blueprint_with, facts, measure};
    use crate::{Sensor, sensor, temperature_sensor};

    const PATIENCE: Duration = Duration::from_secs(20);

    /// Returns a sensor with this config, on a simulated board.
    async fn on(bench: &MemoryBoard, quantity: &str, more: Value) -> Sensor {
        let mut config = json!({ "location": "lab", "quantity": quantity, "line": "GPIO17" });
        if let (Value::Object(config), Value::Object(more)) = (&mut config, more) {
            config.extend(more);
        }
        let is_active_low = config["active-low"].as_bool().unwrap_or(false);
        let mut sensor = sensor(&blueprint_with("gpio", config)).expect("a sensor");
        let line = "GPIO17".to_owned().try_into().expect("a name");
        let input = InputSettings { line, is_active_low, bias: None, debounce: None };
        sensor.probe = Arc::new(GpioProbe::new(Arc::new(bench.clone()), input));
        sensor.read_state().expect("it may be away").await;
        sensor
    }

    fn offers(sensor: &Sensor) -> usize {
        sensor.describe().model.actions.len()
    }

    /// Handles events of the sensor until the facts of the sensor are as expected.
    async fn until(sensor: &mut Sensor, expected: &str) {
        let waiting = async {
            while facts(sensor) != expected {
                let stir = sensor.next_event().expect("it notices").await;
                stir(sensor);
            }
        };
        let in_time = tokio::time::timeout(PATIENCE, waiting).await;
        assert!(in_time.is_ok(), "{} is not {expected}", facts(sensor));
    }

    #[tokio::test]
    async fn the_first_value_of_a_line_and_its_edges_are_reported() {
        let bench = MemoryBoard::default();
        bench.plug("GPIO17", true);
        let more = json!({ "active-low": true, "bias": "pull-up", "debounce": "10ms" });
        let mut sensor = on(&bench, "contact", more).await;
        until(&mut sensor, "(located s lab) (contact-at s lab) (known-contact lab) (not (shut s))")
            .await;
        bench.set("GPIO17", false);
        until(&mut sensor, "(located s lab) (contact-at s lab) (known-contact lab) (shut s)").await;
        bench.set("GPIO17", true);
        until(&mut sensor, "(located s lab) (contact-at s lab) (known-contact lab) (not (shut s))")
            .await;
        let performed = measure(&mut sensor, "contact").await.expect("it is there");
        assert_eq!(performed.detail, "open at lab");
    }

    #[tokio::test]
    async fn an_unplugged_chip_makes_its_agent_unavailable_until_it_is_back() {
        let bench = MemoryBoard::default();
        let mut sensor = on(&bench, "motion", json!({})).await;
        assert_eq!(offers(&sensor), 0, "it was never here");
        let failure = measure(&mut sensor, "motion").await.expect_err("it is away");
        assert!(failure.to_string().starts_with("find a line named `GPIO17`; "), "{failure}");
        bench.plug("GPIO17", false);
        until(&mut sensor, "(located s lab) (known-motion lab) (not (motion lab))").await;
        assert_eq!(offers(&sensor), 1, "at once");
        bench.set("GPIO17", true);
        until(&mut sensor, "(located s lab) (known-motion lab) (motion lab)").await;
        bench.unplug("GPIO17");
        until(&mut sensor, "(located s lab) (not (known-motion lab)) (unknown (motion lab))").await;
        assert_eq!(offers(&sensor), 0);
        bench.plug("GPIO17", true);
        until(&mut sensor, "(located s lab) (known-motion lab) (motion lab)").await;
        assert_eq!(offers(&sensor), 1);
    }

    #[test]
    fn errors_of_an_entry_name_the_correction() {
        let names_no_line = "names no line: write its chip and number, such as \"gpiochip0/17\"";
        for (config, expected) in [
            (json!({ "quantity": "motion" }), "driver `gpio` needs a `line`: its chip and number"),
            (json!({ "quantity": "motion", "line": "17" }), names_no_line),
            (json!({ "quantity": "motion", "line": "a", "bias": "up" }), "unknown variant `up`"),
            (
                json!({ "quantity": "motion", "line": "a", "debounce": "1h" }),
                "debounce `1h`: write a time between 0s and 10s",
            ),
            (
                json!({ "quantity": "co2", "line": "GPIO17" }),
                "driver `gpio` measures what is yes or no: motion, reflection, contact; and no co2",
            ),
            (
                json!({ "quantity": "motion", "line": "a", "topic": "b" }),
                "`topic` is for `driver = \"mqtt\"`, and this driver is `gpio`",
            ),
        ] {
            let mut config = config;
            config["location"] = json!("lab");
            let built = sensor(&blueprint_with("gpio", config));
            let problem = built.err().map(|error| error.to_string()).unwrap_or_default();
            assert!(problem.contains(expected), "{problem} is not {expected}");
        }
        let config = json!({ "location": "lab", "line": "a" });
        assert!(temperature_sensor(&blueprint_with("gpio", config)).is_err());
    }
}
