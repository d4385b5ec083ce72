//! The Linux driver, which measures with a device of this machine's kernel (Industrial I/O,
//! hardware monitoring, 1-wire).
//!
//! - The driver searches for the device by its name and place for each measurement, because the
//!   device may have been unplugged meanwhile, and be back under another number.
//! - A failed reading is repeated within the time limit of a measurement, because one reading in
//!   five of a DHT22 fails although the sensor works. Only a device that never answers has failed.
//! - The driver periodically checks whether the device is plugged in. The kernel notifies only
//!   processes with more rights than those for reading.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use linux_sensors::{FindError, SensorChannel, Sysfs};
use tokio::time::Instant;

use crate::config::HardwareConfig;
use crate::quantity::SensorQuantity;
use crate::{MEASURING, Measurement, Probe};

/// Time limit for beginning a reading. A reading that begins by then ends before the method times
/// out.
const TRYING: Duration = Duration::from_millis(1_200);
const _: () = assert!(TRYING.as_millis() + SLOWEST.as_millis() < MEASURING.as_millis());

/// Duration of the slowest reading: that of a 1-wire thermometer.
const SLOWEST: Duration = Duration::from_millis(750);

/// Pause before a failed reading is repeated, during which a disturbed bus can settle.
const PAUSE: Duration = Duration::from_millis(100);

/// Pause between two checks whether the device is plugged in: about the time that a person needs to
/// plug it in.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

#[derive(Clone)]
struct LinuxProbe {
    sysfs: Sysfs,
    device: String,
    channel: Option<String>,
    measures: Vec<linux_sensors::SysfsQuantity>,
    is_present: Arc<AtomicBool>,
    /// Channels from the last search. As long as they exist, no new search of all devices of the
    /// machine is needed.
    found: Arc<Mutex<Vec<SensorChannel>>>,
}

pub(crate) fn probe(
    blueprint: &Blueprint,
    hardware: HardwareConfig,
    quantities: &[&'static SensorQuantity],
) -> Result<Arc<dyn Probe>, BuildError> {
    let HardwareConfig { device, channel, sysfs, .. } = hardware;
    let device = device.ok_or_else(|| {
        let problem = "driver `linux` needs a `device`; `althing sensors` lists those of a machine";
        blueprint.problem(problem)
    })?;
    let measures = quantities.iter().map(|quantity| {
        linux_sensors::SysfsQuantity::named(quantity.name).ok_or_else(|| {
            let known = linux_sensors::SysfsQuantity::ALL.map(|known| known.name()).join(", ");
            let name = quantity.name;
            blueprint.problem(format!("driver `linux` measures {known}, and no {name}"))
        })
    });
    let measures = measures.collect::<Result<_, _>>()?;
    let sysfs = sysfs.map_or_else(Sysfs::default, Sysfs::new);
    let (is_here, found) = (Arc::new(AtomicBool::new(true)), Arc::default());
    Ok(Arc::new(LinuxProbe { sysfs, device, channel, measures, is_present: is_here, found }))
}

impl LinuxProbe {
    /// Measures a quantity once, without repetition. Blocks the thread.
    fn measure_once(&self, quantity: linux_sensors::SysfsQuantity) -> Result<f64, String> {
        let channel = self.sysfs.find(&self.device, quantity, self.channel.as_deref());
        let channel = channel.map_err(|error| error.to_string())?;
        channel.read().map_err(|error| error.to_string())
    }

    /// Checks whether the device is plugged in. Blocks the thread.
    fn is_found(&self) -> bool {
        let mut found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        if !found.is_empty() && found.iter().all(SensorChannel::is_present) {
            return true;
        }
        found.clear();
        self.measures.iter().all(|quantity| {
            match self.sysfs.find(&self.device, *quantity, self.channel.as_deref()) {
                Ok(channel) => found.push(channel),
                Err(FindError::Unknown { .. }) => return false,
                // An ambiguous name is reported when the channel is read.
                Err(_) => (),
            }
            true
        })
    }
}

impl Probe for LinuxProbe {
    fn measure(&self, quantity: &'static str) -> BoxFuture<Result<Measurement, String>> {
        let linux = self.clone();
        Box::pin(async move {
            let known = linux_sensors::SysfsQuantity::named(quantity);
            let known = known.ok_or_else(|| format!("measure {quantity} with this driver"))?;
            let began = Instant::now();
            loop {
                let trying = linux.clone();
                let value = run_blocking(move || trying.measure_once(known)).await?;
                match value {
                    Ok(value) => return Ok(Measurement { value, at: Instant::now() }),
                    Err(_) if began.elapsed() + PAUSE < TRYING => tokio::time::sleep(PAUSE).await,
                    Err(problem) => return Err(problem),
                }
            }
        })
    }

    /// Returns an error, because this driver measures no yes-or-no quantities.
    fn notice(
        &self,
        quantity: &'static str,
        _known: f64,
    ) -> BoxFuture<Result<Measurement, String>> {
        let problem = format!("notice {quantity} with this driver");
        Box::pin(std::future::ready(Err(problem)))
    }

    fn is_present(&self) -> bool {
        self.is_present.load(Ordering::Relaxed)
    }

    fn check_presence(&self) -> Option<BoxFuture<()>> {
        let linux = self.clone();
        Some(Box::pin(async move {
            let looking = linux.clone();
            if let Ok(is_here) = run_blocking(move || looking.is_found()).await {
                linux.is_present.store(is_here, Ordering::Relaxed);
            }
        }))
    }

    fn wait_for_news(&self) -> Option<BoxFuture<()>> {
        let linux = self.clone();
        Some(Box::pin(async move {
            let before = linux.is_present();
            while linux.is_present() == before {
                tokio::time::sleep(LOOK_AGAIN).await;
                if let Some(look) = linux.check_presence() {
                    look.await;
                }
            }
            let what = if before { "unplugged" } else { "plugged in" };
            tracing::info!(device = linux.device, "{what}");
        }))
    }
}

/// Runs `work`, which may block, on a separate thread. Returns an error if `work` panics or cannot
/// run.
async fn run_blocking<T: Send + 'static>(
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, String> {
    tokio::task::spawn_blocking(work).await.map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::PathBuf;

    use serde_json::json;
    use tempfile::TempDir;

    use super::*;
    use crate::tests::{blueprint_with, facts, measure};
    use crate::{REST_AFTER_FAILURE, Sensor, sensor, temperature_sensor};

    const DEVICE: &str = "bme280@i2c-1/1-0076";

    /// Folder with the devices of a machine's kernel, in which there is a sensor of temperature and
    /// humidity.
    struct Machine(TempDir);

    impl Machine {
        fn new() -> Machine {
            let machine = Machine(tempfile::tempdir().expect("a folder"));
            machine.plug(0);
            machine
        }

        fn file(&self, number: u8, name: &str) -> PathBuf {
            let device = self.0.path().join("devices/i2c-1/1-0076");
            device.join(format!("iio:device{number}/{name}"))
        }

        /// Adds the sensor to the folder, with the number `number` of the kernel.
        fn plug(&self, number: u8) {
            let iio = self.file(number, "in_temp_input");
            let iio = iio.parent().expect("a folder");
            fs::create_dir_all(iio).expect("a folder");
            fs::write(iio.with_file_name("name"), "bme280\n").expect("a file");
            fs::write(self.file(number, "in_temp_input"), "21500\n").expect("a file");
            fs::write(self.file(number, "in_humidityrelative_input"), "40000\n").expect("a file");
            let all = self.0.path().join("bus/iio/devices");
            fs::create_dir_all(&all).expect("a folder");
            let link = all.join(format!("iio:device{number}"));
            std::os::unix::fs::symlink(iio, link).expect("a link");
        }

        fn unplug(&self, number: u8) {
            fs::remove_dir_all(self.0.path().join("devices/i2c-1")).expect("it was there");
            let link = self.0.path().join(format!("bus/iio/devices/iio:device{number}"));
            fs::remove_file(link).expect("it was there");
        }

        fn blueprint(&self, mut config: serde_json::Value) -> Blueprint {
            config["location"] = json!("lab");
            config["sysfs"] = json!(self.0.path());
            blueprint_with("linux", config)
        }

        async fn sensor(&self) -> Sensor {
            let config = json!({ "device": DEVICE, "humidity": true });
            let sensor = temperature_sensor(&self.blueprint(config)).expect("a sensor");
            self::look(&sensor).await;
            sensor
        }
    }

    async fn look(sensor: &Sensor) {
        actuator::Device::read_state(sensor).expect("it can be unplugged").await;
    }

    fn offers(sensor: &Sensor) -> usize {
        actuator::Device::describe(sensor).model.actions.len()
    }

    async fn stir(sensor: &mut Sensor) {
        let stir = actuator::Device::next_event(sensor).expect("it can be unplugged").await;
        stir(sensor);
    }

    #[tokio::test(start_paused = true)]
    async fn the_values_of_the_kernel_become_facts() {
        let machine = Machine::new();
        let mut sensor = machine.sensor().await;
        assert_eq!(offers(&sensor), 2);
        let performed = measure(&mut sensor, "temperature").await.expect("it is plugged in");
        assert_eq!(performed.detail, "21.5 °C at lab");
        assert!(measure(&mut sensor, "humidity").await.is_ok());
        let known = facts(&sensor);
        assert!(known.contains("(= (temperature lab) 21.5)"), "{known}");
        assert!(known.contains("(= (humidity lab) 40)"), "{known}");
    }

    #[tokio::test]
    async fn an_occasional_failed_reading_is_repeated_and_permanent_failure_is_reported() {
        let machine = Machine::new();
        let mut sensor = machine.sensor().await;
        let file = machine.file(0, "in_temp_input");
        fs::write(&file, "").expect("a file");
        let recovers = async {
            tokio::time::sleep(3 * PAUSE).await;
            fs::write(&file, "19000\n").expect("a file");
        };
        let (performed, ()) = tokio::join!(measure(&mut sensor, "temperature"), recovers);
        assert_eq!(performed.expect("it recovered").detail, "19.0 °C at lab");

        fs::write(&file, "").expect("a file");
        let failure = measure(&mut sensor, "temperature").await.expect_err("it says nothing");
        assert!(failure.to_string().contains("is no number"), "{failure}");
        assert_eq!(offers(&sensor), 0, "it rests");
    }

    #[tokio::test(start_paused = true)]
    async fn an_unplugged_device_offers_no_actions_until_it_is_back_under_any_number() {
        let machine = Machine::new();
        let mut sensor = machine.sensor().await;
        machine.unplug(0);
        assert!(measure(&mut sensor, "temperature").await.is_err());
        stir(&mut sensor).await;
        tokio::time::advance(REST_AFTER_FAILURE).await;
        assert_eq!(offers(&sensor), 0);
        machine.plug(7);
        stir(&mut sensor).await;
        assert_eq!(offers(&sensor), 2, "at once");
        assert!(measure(&mut sensor, "temperature").await.is_ok());

        machine.unplug(7);
        let late = machine.sensor().await;
        assert_eq!(offers(&late), 0, "it was never here");
    }

    #[test]
    fn errors_of_an_entry_name_the_correction() {
        let machine = Machine::new();
        for (config, expected) in [
            (
                json!({ "quantity": "co2" }),
                "build `s`: driver `linux` needs a `device`; `althing sensors` lists those of a machine",
            ),
            (
                json!({ "quantity": "motion", "device": DEVICE }),
                "build `s`: driver `linux` measures temperature, humidity, co2, light, distance, \
                 and no motion",
            ),
        ] {
            let built = sensor(&machine.blueprint(config));
            assert_eq!(built.err().map(|error| error.to_string()).as_deref(), Some(expected));
        }
        let config = json!({ "quantity": "co2", "location": "lab", "device": DEVICE });
        let built = sensor(&blueprint_with("simulated", config));
        let expected =
            "build `s`: `device` is for `driver = \"linux\"`, and this driver is `simulated`";
        assert_eq!(built.err().map(|error| error.to_string()).as_deref(), Some(expected));
    }
}
