//! The Phidget driver, which measures with sensors on a USB interface kit or hub of Phidgets Inc.
//! Their library is loaded at the first use (`phidget-link`).
//!
//! - A channel stays open as long as its sensor is an agent. The library detects a device that is
//!   plugged in again.
//! - A failed reading is repeated within the time limit of a measurement, because a device that was
//!   just plugged in does not have values at once.
//! - If the library hangs, only the channel in use is blocked. Calls that wait for this channel
//!   time out.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use phidget_link::{Library, PartAddress, PhidgetChannel, PhidgetPart};
use tokio::time::Instant;

use crate::config::{HardwareConfig, PhidgetWiring};
use crate::quantity::{SensorQuantity, is_yes};
use crate::{MEASURING, Measurement, Probe};

/// Time limit for waiting for a device when a channel is opened. This is the minimum of the
/// library.
const OPENING: Duration = Duration::from_secs(1);

/// Time limit for beginning a reading.
const TRYING: Duration = Duration::from_millis(1_200);
const _: () = assert!(OPENING.as_millis() < TRYING.as_millis());

/// Time limit for an answer of the library. It is a little shorter than the time limit of the
/// method.
const ANSWERING: Duration = Duration::from_millis(1_900);
const _: () = assert!(TRYING.as_millis() < ANSWERING.as_millis());
const _: () = assert!(ANSWERING.as_millis() < MEASURING.as_millis());

/// Pause before a failed reading is repeated, and between two readings while a change is awaited.
/// An interface kit has a new value every quarter of a second, and a digital input has a new value
/// at once.
const PAUSE: Duration = Duration::from_millis(100);

/// Pause between two checks whether the device is plugged in: about the time that a person needs to
/// plug it in.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// Time for which motion lasts after the last swing of the sensor's value. When a person walks
/// past, the value rests for up to a second between two swings.
const MOVING: Duration = Duration::from_secs(3);

#[derive(Clone)]
struct PhidgetProbe {
    library: Option<PathBuf>,
    /// Parts of the sensor, one per quantity.
    lines: Vec<Arc<PhidgetLine>>,
    is_present: Arc<AtomicBool>,
    /// The last reason why the device is unavailable; kept so that each reason is logged only once.
    trouble: Arc<Mutex<Option<String>>>,
}

/// The part that measures one quantity.
struct PhidgetLine {
    quantity: &'static str,
    part: &'static PhidgetPart,
    address: PartAddress,
    factor: f64,
    /// Channel of the part. It is opened at the first use, so that no channel is opened before the
    /// agent is active.
    channel: Arc<tokio::sync::Mutex<Option<PhidgetChannel>>>,
    /// Time at which the value last swung beyond the threshold of motion; `None` before the first
    /// swing. Only the values of some motion detectors swing (`PhidgetPart::swings`).
    swung: Mutex<Option<Instant>>,
}

pub(crate) fn probe(
    blueprint: &Blueprint,
    hardware: HardwareConfig,
    quantities: &[&'static SensorQuantity],
) -> Result<Arc<dyn Probe>, BuildError> {
    let HardwareConfig { wiring, factor, .. } = hardware;
    let names: Vec<_> = quantities.iter().map(|quantity| quantity.name).collect();
    let lines = lines(&wiring, factor, &names).map_err(|problem| blueprint.problem(problem))?;
    let (is_here, trouble) = (Arc::new(AtomicBool::new(true)), Arc::default());
    Ok(Arc::new(PhidgetProbe { library: wiring.library, lines, is_present: is_here, trouble }))
}

/// Returns the part for each of the quantities, with the part's address.
fn lines(
    wiring: &PhidgetWiring,
    factor: Option<f64>,
    quantities: &[&'static str],
) -> Result<Vec<Arc<PhidgetLine>>, String> {
    let mut lines = Vec::new();
    for quantity in quantities.iter().copied() {
        let known = phidget_link::PhidgetQuantity::named(quantity).ok_or_else(|| {
            let known = phidget_link::PhidgetQuantity::ALL.map(|known| known.name()).join(", ");
            format!("driver `phidget` measures {known}, and no {quantity}")
        })?;
        let part = PhidgetPart::find(wiring.sensor.as_deref(), known)?;
        let address = address(wiring, part, quantity, quantities.len() > 1)?;
        let factor = scale(part, factor)?;
        let (channel, swung) = (Arc::default(), Mutex::default());
        lines.push(Arc::new(PhidgetLine { quantity, part, address, factor, channel, swung }));
    }
    let is_of_two_cables = lines.len() > 1 && lines.iter().any(|line| line.part.has_cables());
    if wiring.humidity_port.is_some() && !is_of_two_cables {
        return Err("`humidity-port` is for a sensor with two cables when both are used: \
                    `sensor = \"1125\"` and `humidity = true`"
            .to_owned());
    }
    Ok(lines)
}

/// Returns the address of the part that measures a quantity.
fn address(
    wiring: &PhidgetWiring,
    part: &PhidgetPart,
    quantity: &str,
    is_one_of_two: bool,
) -> Result<PartAddress, String> {
    let PhidgetWiring { serial, mut hub_port, mut port, humidity_port, .. } = *wiring;
    if part.needs_input() && hub_port.is_none() && port.is_none() {
        return Err(format!(
            "{part} needs an input: write the `port` of the interface kit, or the `hub-port`"
        ));
    }
    if is_one_of_two && part.has_cables() {
        let humidity_port = humidity_port.ok_or_else(|| {
            format!(
                "{part} has two cables: write the `humidity-port`, the port of its humidity cable"
            )
        })?;
        let place = if port.is_some() { &mut port } else { &mut hub_port };
        if *place == Some(humidity_port) {
            let problem = "has two cables: `humidity-port` must differ from the temperature's";
            return Err(format!("{part} {problem}"));
        }
        if quantity == "humidity" {
            *place = Some(humidity_port);
        }
    }
    let serial = serial.map(|serial| {
        i32::try_from(serial).map_err(|_| format!("serial = {serial}: no Phidget has that number"))
    });
    Ok(PartAddress { serial: serial.transpose()?, hub_port, port })
}

/// Returns the factor that converts the part's value to the quantity's unit.
fn scale(part: &PhidgetPart, factor: Option<f64>) -> Result<f64, String> {
    match factor {
        Some(_) if !part.is_unscaled() => Err(format!("{part} has a unit: leave the `factor` out")),
        Some(factor) if factor.is_finite() && factor > 0.0 => Ok(factor),
        Some(factor) => Err(format!("factor = {factor}: write a number greater than 0")),
        None if part.is_unscaled() => Err(format!(
            "{part} reports brightness without a unit: write a `factor`, the lux at its maximum"
        )),
        None => Ok(1.0),
    }
}

impl PhidgetLine {
    /// Runs `work` with the channel on a thread for blocking work, and waits for the result until
    /// `until`. Opens the channel first if it is not open.
    async fn with<T: Send + 'static>(
        &self,
        library: Option<PathBuf>,
        until: Instant,
        work: impl FnOnce(&mut PhidgetChannel) -> Result<T, phidget_link::CallError> + Send + 'static,
    ) -> Result<T, String> {
        let (part, address) = (self.part, self.address);
        let channel = Arc::clone(&self.channel);
        let answered = async move {
            // A call that hangs keeps the lock, so that only one thread can hang in the library.
            let mut channel = channel.lock_owned().await;
            let work = move || {
                let opened = match channel.take() {
                    Some(opened) => opened,
                    None => open(library, part, address)?,
                };
                work(channel.insert(opened)).map_err(|error| error.to_string())
            };
            tokio::task::spawn_blocking(work).await.map_err(|error| error.to_string())?
        };
        let answered = tokio::time::timeout_at(until, answered).await;
        answered.unwrap_or_else(|_| {
            Err(format!("reach {part} at {address} in time: libphidget22 does not answer"))
        })
    }

    /// Converts a value of the part to the quantity's unit. For a part with a value that swings,
    /// returns 1 until the value has been at rest for [`MOVING`].
    fn settled(&self, value: f64) -> f64 {
        let mut swung = lock(&self.swung);
        if self.part.swings() && is_yes(value) {
            *swung = Some(Instant::now());
        }
        match *swung {
            Some(at) if at.elapsed() < MOVING => 1.0,
            _ => value * self.factor,
        }
    }
}

fn open(
    library: Option<PathBuf>,
    part: &'static PhidgetPart,
    address: PartAddress,
) -> Result<PhidgetChannel, String> {
    let library = Library::load(library.as_deref()).map_err(|error| error.to_string())?;
    PhidgetChannel::open(library, part, address, OPENING).map_err(|error| error.to_string())
}

impl PhidgetProbe {
    fn line(&self, quantity: &str) -> Result<Arc<PhidgetLine>, String> {
        let line = self.lines.iter().find(|line| line.quantity == quantity);
        line.cloned().ok_or_else(|| format!("measure {quantity} with this driver"))
    }

    /// Measures the quantity of `line`. Failed readings are repeated until the time limit.
    async fn try_to_measure(&self, line: &PhidgetLine) -> Result<Measurement, String> {
        let (began, until) = (Instant::now(), Instant::now() + ANSWERING);
        loop {
            match line.with(self.library.clone(), until, PhidgetChannel::read).await {
                Ok(value) => {
                    return Ok(Measurement { value: line.settled(value), at: Instant::now() });
                }
                Err(_) if began.elapsed() + PAUSE < TRYING => tokio::time::sleep(PAUSE).await,
                Err(problem) => return Err(problem),
            }
        }
    }

    /// Checks whether the device is plugged in.
    async fn check_attached(&self) -> bool {
        let (mut found, until) = (Ok(()), Instant::now() + ANSWERING);
        for line in &self.lines {
            if found.is_ok() {
                found =
                    line.with(self.library.clone(), until, PhidgetChannel::check_attached).await;
            }
        }
        let is_here = found.is_ok();
        self.is_present.store(is_here, Ordering::Relaxed);
        let mut trouble = lock(&self.trouble);
        if let Err(problem) = &found
            && trouble.as_ref() != Some(problem)
        {
            tracing::warn!("failed to {problem}");
        }
        if is_here && trouble.is_some() {
            tracing::info!("plugged in");
        }
        *trouble = found.err();
        is_here
    }

    async fn until_here(&self) {
        while !self.check_attached().await {
            tokio::time::sleep(LOOK_AGAIN).await;
        }
    }
}

impl Probe for PhidgetProbe {
    fn measure(&self, quantity: &'static str) -> BoxFuture<Result<Measurement, String>> {
        let phidget = self.clone();
        Box::pin(async move { phidget.try_to_measure(&*phidget.line(quantity)?).await })
    }

    fn notice(&self, quantity: &'static str, known: f64) -> BoxFuture<Result<Measurement, String>> {
        let phidget = self.clone();
        Box::pin(async move {
            let line = phidget.line(quantity)?;
            // If the sensor was unavailable, its value is unknown, so that any value must be
            // reported.
            let mut is_news = !phidget.is_present();
            if is_news {
                phidget.until_here().await;
            }
            loop {
                let measured = match phidget.try_to_measure(&line).await {
                    Ok(measured) => measured,
                    Err(problem) => {
                        // The caller logs the problem. It is stored here, so that `check_attached`
                        // does not log it again.
                        *lock(&phidget.trouble) = Some(problem.clone());
                        phidget.check_attached().await;
                        return Err(problem);
                    }
                };
                is_news |= is_yes(measured.value) != is_yes(known);
                if is_news {
                    return Ok(measured);
                }
                tokio::time::sleep(PAUSE).await;
            }
        })
    }

    fn is_present(&self) -> bool {
        self.is_present.load(Ordering::Relaxed)
    }

    fn check_presence(&self) -> Option<BoxFuture<()>> {
        let phidget = self.clone();
        Some(Box::pin(async move {
            phidget.check_attached().await;
        }))
    }

    fn wait_for_news(&self) -> Option<BoxFuture<()>> {
        let phidget = self.clone();
        Some(Box::pin(async move {
            let before = phidget.is_present();
            while phidget.is_present() == before {
                tokio::time::sleep(LOOK_AGAIN).await;
                phidget.check_attached().await;
            }
        }))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
#[path = "../../../../daemon/devices/phidget-link/tests/fake/mod.rs"]
mod fake;

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::fake::Fake;
    use super::*;
    use crate::tests::{BLIND, STILL, blueprint_with, facts, measure};
    use crate::{REST_AFTER_FAILURE, Sensor, sensor, temperature_sensor};

    /// Returns a thermometer, or a sensor of the quantity in `more`.
    fn sensor_of(more: Value) -> Result<Sensor, BuildError> {
        let is_any = more.get("quantity").is_some();
        let mut config = json!({ "location": "lab" });
        if let (Value::Object(config), Value::Object(more)) = (&mut config, more) {
            config.extend(more);
        }
        let blueprint = blueprint_with("phidget", config);
        if is_any { sensor(&blueprint) } else { temperature_sensor(&blueprint) }
    }

    /// Returns a sensor that is connected to the simulated interface kit.
    async fn built(kit: &Fake, mut more: Value) -> Sensor {
        more["library"] = json!(kit.library());
        more["serial"] = json!(12345);
        let sensor = sensor_of(more).expect("a sensor");
        actuator::Device::read_state(&sensor).expect("it can be unplugged").await;
        sensor
    }

    /// Returns a simulated interface kit with the paper's sensors.
    fn kit() -> Fake {
        let mut fake = Fake::new();
        fake.set("plugged", 1.0);
        for (line, value) in [
            ("ratio.0.11252", 21.5),
            ("ratio.1.11251", 40.0),
            ("ratio.2.11012", 25.5),
            ("ratio.3.11110", 0.02),
            ("ratio.4.11030", 0.0),
            ("ratio.5.11050", 0.25),
            ("voltage.6.11270", 500.0),
        ] {
            fake.set(line, value);
        }
        fake
    }

    fn offers(sensor: &Sensor) -> usize {
        actuator::Device::describe(sensor).model.actions.len()
    }

    async fn stir(sensor: &mut Sensor) {
        let watched = actuator::Device::next_event(sensor).expect("it can be unplugged");
        let stir = tokio::time::timeout(Duration::from_secs(60), watched).await;
        stir.expect("something happens")(sensor);
    }

    #[tokio::test]
    async fn the_sensors_of_the_paper_measure() {
        let kit = kit();
        for (config, quantity, expected) in [
            (
                json!({ "sensor": "1125", "port": 0, "humidity-port": 1, "humidity": true }),
                "humidity",
                "40 % humidity at lab",
            ),
            (json!({ "sensor": "1125", "port": 0 }), "temperature", "21.5 °C at lab"),
            (
                json!({ "quantity": "distance", "sensor": "1101-2Y0A21", "port": 2 }),
                "distance",
                "0.26 m of free distance at lab",
            ),
            (
                json!({ "quantity": "motion", "sensor": "1111", "port": 3 }),
                "motion",
                "no motion at lab",
            ),
            (
                json!({ "quantity": "reflection", "sensor": "1103", "port": 4 }),
                "reflection",
                "nothing close by at lab",
            ),
            (
                json!({ "quantity": "light", "sensor": "1105", "port": 5, "factor": 1000 }),
                "light",
                "250 lx at lab",
            ),
            (json!({ "quantity": "light", "sensor": "1127", "port": 6 }), "light", "500 lx at lab"),
        ] {
            let mut sensor = built(&kit, config).await;
            let performed = measure(&mut sensor, quantity).await.expect("it is plugged in");
            assert_eq!(performed.detail, expected);
        }
        assert_eq!(kit.count("create"), kit.count("delete"), "nothing is left open");
    }

    #[tokio::test]
    async fn an_occasional_failed_reading_is_repeated_and_permanent_failure_is_reported() {
        let mut kit = kit();
        kit.set("fail_every", 2.0);
        let mut sensor = built(&kit, json!({ "sensor": "1125", "port": 0 })).await;
        for _ in 0..4 {
            assert!(measure(&mut sensor, "temperature").await.is_ok());
        }
        kit.set("fail_every", 1.0);
        let failure = measure(&mut sensor, "temperature").await.expect_err("it says nothing");
        let expected = "read a 1125 at port 0 of Phidget 12345: Unexpected Error";
        assert!(failure.to_string().contains(expected), "{failure}");
        assert_eq!(offers(&sensor), 0, "it rests");
    }

    #[tokio::test(start_paused = true)]
    async fn an_unplugged_device_offers_no_actions_until_it_is_back() {
        let mut kit = kit();
        let wiring = json!({ "sensor": "1125", "port": 0, "humidity-port": 1, "humidity": true });
        let mut sensor = built(&kit, wiring.clone()).await;
        assert_eq!(offers(&sensor), 2);
        kit.set("plugged", 0.0);
        let failure = measure(&mut sensor, "temperature").await.expect_err("it is unplugged");
        assert!(failure.to_string().contains("it was unplugged"), "{failure}");
        stir(&mut sensor).await;
        tokio::time::advance(REST_AFTER_FAILURE).await;
        assert_eq!(offers(&sensor), 0);
        kit.set("plugged", 2.0);
        stir(&mut sensor).await;
        assert_eq!(offers(&sensor), 2, "at once");
        assert!(measure(&mut sensor, "temperature").await.is_ok());
        assert!(measure(&mut sensor, "humidity").await.is_ok());

        kit.set("plugged", 0.0);
        let mut late = built(&kit, wiring).await;
        assert_eq!(offers(&late), 0, "it was never here");
        kit.set("plugged", 3.0);
        stir(&mut late).await;
        assert_eq!(offers(&late), 2);
    }

    #[tokio::test(start_paused = true)]
    async fn motion_lasts_until_the_value_rests_and_an_unplugged_detector_is_unknown() {
        let mut kit = kit();
        let wiring = json!({ "quantity": "motion", "sensor": "1111", "port": 3 });
        let mut sensor = built(&kit, wiring).await;
        for swing in [-0.6, 0.6] {
            kit.set("ratio.3.11110", swing);
            stir(&mut sensor).await;
            assert!(facts(&sensor).ends_with(" (motion lab)"), "{}", facts(&sensor));
            // Between two swings the person is still moving.
            kit.set("ratio.3.11110", 0.0);
            let halfway = measure(&mut sensor, "motion").await.expect("it is plugged in");
            assert_eq!(halfway.detail, "motion at lab");
            let began = Instant::now();
            stir(&mut sensor).await;
            assert!(began.elapsed() + PAUSE >= MOVING);
            assert_eq!(facts(&sensor), STILL);
        }

        kit.set("plugged", 0.0);
        stir(&mut sensor).await;
        assert_eq!(facts(&sensor), BLIND);
        assert_eq!(offers(&sensor), 0);
        let watched = actuator::Device::next_event(&mut sensor).expect("it waits for it");
        kit.set("plugged", 2.0);
        let back = Instant::now();
        watched.await(&mut sensor);
        assert!(back.elapsed() <= LOOK_AGAIN, "{:?}", back.elapsed());
        assert_eq!(facts(&sensor), STILL, "of one that is back");
        assert_eq!(offers(&sensor), 1);
    }

    #[tokio::test]
    async fn a_hanging_library_blocks_no_other_channel() {
        let mut kit = kit();
        let mut sensor = built(&kit, json!({ "sensor": "1125", "port": 0 })).await;
        kit.set("hang_ms", 6_000.0);
        for _ in 0..2 {
            let began = Instant::now();
            let failure = measure(&mut sensor, "temperature").await.expect_err("it hangs");
            let expected = "reach a 1125 at port 0 of Phidget 12345 in time: libphidget22 does";
            assert!(failure.to_string().contains(expected), "{failure}");
            assert!(began.elapsed() < 2 * MEASURING, "it would hang for six seconds");
        }
        assert_eq!(kit.count("create"), 1, "no other channel is opened meanwhile");
    }

    #[tokio::test(start_paused = true)]
    async fn without_the_library_the_sensor_is_unavailable_and_reports_how_to_install_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let gone = folder.path().join("gone.so");
        let mut sensor = sensor_of(json!({ "library": gone })).expect("nothing is opened yet");
        let failure = measure(&mut sensor, "temperature").await.expect_err("there is none");
        let failure = failure.to_string();
        assert!(failure.contains("load libphidget22: there is no /"), "{failure}");
        assert!(failure.contains("`pip install phidget22`"), "{failure}");
        actuator::Device::read_state(&sensor).expect("it can be unplugged").await;
        tokio::time::advance(REST_AFTER_FAILURE).await;
        assert_eq!(offers(&sensor), 0);
    }

    #[test]
    fn errors_of_an_entry_name_the_correction() {
        for (config, expected) in [
            (
                json!({ "quantity": "co2" }),
                "driver `phidget` measures temperature, humidity, light, distance, motion, \
                 reflection, and no co2",
            ),
            (
                json!({ "quantity": "temperature", "sensor": "1111", "port": 1 }),
                "a `1111` measures motion, and no temperature: write no `sensor` (a Phidget \
                 that measures by itself) or `sensor = \"1125\"` or `sensor = \"1124\"`",
            ),
            (
                json!({ "quantity": "motion", "sensor": "1111" }),
                "a 1111 needs an input: write the `port` of the interface kit, or the `hub-port`",
            ),
            (
                json!({ "humidity": true, "sensor": "1125", "port": 0 }),
                "a 1125 has two cables: write the `humidity-port`, the port of its humidity cable",
            ),
            (
                json!({ "humidity": true, "sensor": "1125", "port": 0, "humidity-port": 0 }),
                "a 1125 has two cables: `humidity-port` must differ from the temperature's",
            ),
            (
                json!({ "sensor": "1125", "port": 0, "humidity-port": 1 }),
                "`humidity-port` is for a sensor with two cables when both are used: \
                 `sensor = \"1125\"` and `humidity = true`",
            ),
            (
                json!({ "quantity": "light", "sensor": "1105", "port": 0 }),
                "a 1105 reports brightness without a unit: write a `factor`, the lux at its \
                 maximum",
            ),
            (
                json!({ "quantity": "light", "sensor": "1127", "port": 0, "factor": 2 }),
                "a 1127 has a unit: leave the `factor` out",
            ),
            (
                json!({ "serial": 4_000_000_000_u32 }),
                "serial = 4000000000: no Phidget has that number",
            ),
        ] {
            let problem = sensor_of(config).err().map(|error| error.to_string());
            assert_eq!(problem, Some(format!("build `s`: {expected}")));
        }
        let config = json!({ "quantity": "co2", "location": "lab", "port": 1 });
        let built = sensor(&blueprint_with("simulated", config));
        let expected =
            "build `s`: `port` is for `driver = \"phidget\"`, and this driver is `simulated`";
        assert_eq!(built.err().map(|error| error.to_string()).as_deref(), Some(expected));
    }
}
