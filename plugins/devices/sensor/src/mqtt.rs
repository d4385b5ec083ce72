//! The MQTT driver, which receives the values that a device sends to a broker, for example through
//! Zigbee2MQTT, Tasmota or ESPHome.
//!
//! - There is one connection per broker and process, which all agents share (`mqtt-link`).
//! - Values are announced as soon as they are received. A measurement returns the last value of its
//!   quantity, together with the age of the value, because a message may have only some quantities,
//!   or none at all.
//! - If the `availability` topic reports that the device is offline, or the broker cannot be
//!   reached, the sensor is unavailable and offers no actions.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use mqtt_link::{Broker, BrokerConnection, ReceivedText, TopicState};
use tokio::sync::watch;

use crate::config::HardwareConfig;
use crate::quantity::{SensorQuantity, is_yes};
use crate::text::{self, TextFormat};
use crate::{MEASURING, Measurement, Probe};

/// Time limit for waiting for the broker at the start, and for the first message of the device in a
/// measurement.
const FIRST_TEXT_TIME_MAX: Duration = Duration::from_millis(1_500);
const _: () = assert!(FIRST_TEXT_TIME_MAX.as_millis() < MEASURING.as_millis());

#[derive(Clone)]
struct MqttProbe {
    broker: Broker,
    topic: String,
    availability: Option<String>,
    /// Format of values in texts. Without a JSON pointer, a value is searched for by the quantity's
    /// name.
    format: TextFormat,
    /// Subscriptions. They are created at the first use, so that no connection is opened before the
    /// agent is active.
    subscriptions: Arc<Mutex<Option<TopicSubscriptions>>>,
    /// Number of messages of the device that were handled so far.
    handled_count: Arc<AtomicU64>,
}

/// The subscriptions to the topics of one device.
#[derive(Clone)]
struct TopicSubscriptions {
    trouble: watch::Receiver<Option<String>>,
    texts: watch::Receiver<TopicState>,
    availability: Option<watch::Receiver<TopicState>>,
    _connection: Arc<BrokerConnection>,
}

pub(crate) fn probe(
    blueprint: &Blueprint,
    mut hardware: HardwareConfig,
    quantities: &[&SensorQuantity],
) -> Result<Arc<dyn Probe>, BuildError> {
    let format = hardware.text_format(blueprint, quantities)?;
    let HardwareConfig { broker, user, password_file, ca, topic, availability, .. } = hardware;
    let topic = topic.ok_or_else(|| {
        let problem = "driver `mqtt` needs a `topic`, such as \"zigbee2mqtt/thermometer\"";
        blueprint.problem(problem)
    })?;
    for topic in [Some(&topic), availability.as_ref()].into_iter().flatten() {
        if topic.is_empty() || topic.contains(['+', '#', '\0']) {
            let problem = format!("topic `{topic}`: write that of one device, without + and #");
            return Err(blueprint.problem(problem));
        }
    }
    let broker = Broker::new(broker.as_deref(), user, password_file, ca);
    let broker = broker.map_err(|problem| blueprint.problem(problem))?;
    let (link, told) = (Arc::default(), Arc::default());
    Ok(Arc::new(MqttProbe {
        broker,
        topic,
        availability,
        format,
        subscriptions: link,
        handled_count: told,
    }))
}

impl MqttProbe {
    fn link(&self) -> TopicSubscriptions {
        let mut link = lock(&self.subscriptions);
        let make = || {
            let connection = BrokerConnection::shared(&self.broker, "sensor");
            let listen = |topic: &String| connection.listen(topic);
            TopicSubscriptions {
                trouble: connection.problem(),
                texts: connection.listen(&self.topic),
                availability: self.availability.as_ref().map(listen),
                _connection: Arc::clone(&connection),
            }
        };
        link.get_or_insert_with(make).clone()
    }

    /// Returns the last value of a quantity, or the reason why the quantity has no value. Returns
    /// `None` if no message was received yet.
    fn read(&self, quantity: &str, said: &TopicState) -> Option<Result<Measurement, String>> {
        let named = SensorQuantity::named(quantity).ok()?;
        // A yes or no may have changed while the broker was away, and the device need not repeat it.
        let counts = |word: &&ReceivedText| !named.is_noticed() || word.session == said.session;
        let newest = said.texts.iter().find(counts)?;
        // A text without this quantity does not invalidate an earlier value; a text with an invalid
        // value does.
        let measured = said.texts.iter().filter(counts).find_map(|word| {
            let value = self.format.extract(&word.text, named)?;
            Some(value.map(|value| Measurement { value, at: word.at }))
        });
        let problem =
            |told| format!("find the {quantity} in the message on `{}`: {told}", self.topic);
        Some(match measured {
            Some(measured) => measured.map_err(problem),
            None => Err(problem(text::excerpt(&newest.text))),
        })
    }
}

impl Probe for MqttProbe {
    fn measure(&self, quantity: &'static str) -> BoxFuture<Result<Measurement, String>> {
        let mqtt = self.clone();
        Box::pin(async move {
            let mut link = mqtt.link();
            let heard = link.texts.wait_for(|said| said.count > 0);
            // After this time, the messages received so far are used.
            let _ = tokio::time::timeout(FIRST_TEXT_TIME_MAX, heard).await;
            let measured = mqtt.read(quantity, &link.texts.borrow());
            let trouble = link.trouble.borrow().clone();
            match (measured, trouble) {
                (Some(measured), _) => measured,
                (None, Some(trouble)) => {
                    Err(format!("reach the broker {}: {trouble}", mqtt.broker))
                }
                (None, None) => {
                    Err(format!("receive a value on `{}`: nothing was received yet", mqtt.topic))
                }
            }
        })
    }

    fn notice(&self, quantity: &'static str, known: f64) -> BoxFuture<Result<Measurement, String>> {
        let mqtt = self.clone();
        Box::pin(async move {
            let mut link = mqtt.link();
            loop {
                let measured = mqtt.read(quantity, &link.texts.borrow_and_update());
                // A text without a value changes nothing.
                if let Some(Ok(measured)) = measured
                    && is_yes(measured.value) != is_yes(known)
                {
                    return Ok(measured);
                }
                let changed = link.texts.changed().await;
                changed.map_err(|_| "receive messages from its broker".to_owned())?;
            }
        })
    }

    fn is_present(&self) -> bool {
        // Before the connection is made, the sensor counts as present, because its full action
        // model is needed then.
        let Some(link) = lock(&self.subscriptions).clone() else { return true };
        let is_offline = link.availability.as_ref().is_some_and(|said| {
            let said = said.borrow();
            let newest = said.texts.front().filter(|word| word.session == said.session);
            newest.is_some_and(|word| text::is_offline(&word.text))
        });
        link.trouble.borrow().is_none() && !is_offline
    }

    /// Waits briefly for the broker, so that the first announcement of the agent already has the
    /// true state.
    fn check_presence(&self) -> Option<BoxFuture<()>> {
        let mut link = self.link();
        Some(Box::pin(async move {
            let connected = link.trouble.wait_for(Option::is_none);
            let _ = tokio::time::timeout(FIRST_TEXT_TIME_MAX, connected).await;
        }))
    }

    fn wait_for_news(&self) -> Option<BoxFuture<()>> {
        let (mqtt, mut link) = (self.clone(), self.link());
        let before = self.is_present();
        Some(Box::pin(async move {
            loop {
                let told = mqtt.handled_count.load(Ordering::Relaxed);
                let count = link.texts.borrow_and_update().count;
                link.trouble.mark_unchanged();
                if let Some(said) = &mut link.availability {
                    said.mark_unchanged();
                }
                if count > told || mqtt.is_present() != before {
                    return;
                }
                let available = async {
                    match &mut link.availability {
                        Some(said) => said.changed().await,
                        None => std::future::pending().await,
                    }
                };
                // None of these calls fails: `link` keeps the connection open, and with it the
                // senders.
                let _ = tokio::select! {
                    changed = link.texts.changed() => changed,
                    changed = link.trouble.changed() => changed,
                    changed = available => changed,
                };
            }
        }))
    }

    fn last_report(&self, quantity: &'static str) -> Option<Result<Measurement, String>> {
        let link = self.link();
        let said = link.texts.borrow();
        self.handled_count.store(said.count, Ordering::Relaxed);
        self.read(quantity, &said)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use actuator::Device as _;
    use serde_json::{Value, json};

    use super::*;
    use crate::broker::Broker;
    use crate::tests::{BLIND, blueprint_with, facts, measure};
    use crate::{Sensor, sensor, temperature_sensor};

    const PATIENCE: Duration = Duration::from_secs(20);

    /// Returns the config of a sensor, extended by the keys of `more`.
    fn config(broker: &Broker, more: Value) -> Value {
        let mut config =
            json!({ "location": "lab", "broker": broker.name(), "topic": "zigbee2mqtt/thermo" });
        if let (Value::Object(config), Value::Object(more)) = (&mut config, more) {
            config.extend(more);
        }
        config
    }

    async fn thermometer(broker: &Broker) -> Sensor {
        let more = json!({ "humidity": true, "availability": "zigbee2mqtt/thermo/availability" });
        let blueprint = blueprint_with("mqtt", config(broker, more));
        let sensor = temperature_sensor(&blueprint).expect("a sensor");
        sensor.read_state().expect("it may be away").await;
        sensor
    }

    fn offers(sensor: &Sensor) -> usize {
        sensor.describe().model.actions.len()
    }

    /// Handles events of the sensor until `is_so` holds.
    async fn until(sensor: &mut Sensor, is_so: impl Fn(&Sensor) -> bool) {
        let waiting = async {
            while !is_so(sensor) {
                let stir = sensor.next_event().expect("it says things by itself").await;
                stir(sensor);
            }
        };
        let in_time = tokio::time::timeout(PATIENCE, waiting).await;
        assert!(in_time.is_ok(), "{} actions, {}", offers(sensor), facts(sensor));
    }

    #[tokio::test]
    async fn values_become_facts_at_once_and_availability_is_presence() {
        let Some(broker) = Broker::start() else { return };
        let said = r#"{"battery":100,"humidity":44.72,"linkquality":121,"temperature":27.34}"#;
        broker.retain("zigbee2mqtt/thermo", said);
        let mut sensor = thermometer(&broker).await;
        let performed = measure(&mut sensor, "temperature").await.expect("it was retained");
        assert_eq!(performed.detail, "27.3 °C at lab");
        until(&mut sensor, |sensor| facts(sensor).contains("(= (humidity lab) 44.72)")).await;

        broker.say("zigbee2mqtt/thermo", r#"{"humidity":45,"temperature":19}"#);
        until(&mut sensor, |sensor| facts(sensor).contains("(= (temperature lab) 19)")).await;
        // A message about the battery does not invalidate earlier values.
        broker.say("zigbee2mqtt/thermo", r#"{"humidity":46,"battery":97}"#);
        until(&mut sensor, |sensor| facts(sensor).contains("(= (humidity lab) 46)")).await;
        let performed = measure(&mut sensor, "temperature").await.expect("it was said before");
        assert_eq!(performed.detail, "19.0 °C at lab");
        let availability = "zigbee2mqtt/thermo/availability";
        broker.retain(availability, r#"{"state":"offline"}"#);
        until(&mut sensor, |sensor| offers(sensor) == 0).await;
        broker.retain(availability, "online");
        until(&mut sensor, |sensor| offers(sensor) == 2).await;
        // A value that the device reports as `null` is not known.
        broker.say("zigbee2mqtt/thermo", r#"{"humidity":46,"temperature":null}"#);
        let is_unknown = "(not (known-temperature lab))";
        until(&mut sensor, |sensor| facts(sensor).contains(is_unknown)).await;
        assert!(!facts(&sensor).contains("(= (temperature lab)"), "{}", facts(&sensor));
        assert!(facts(&sensor).contains("(= (humidity lab) 46)"));
        let problem = measure(&mut sensor, "temperature").await.expect_err("it is not known");
        assert_eq!(
            problem.to_string(),
            "find the temperature in the message on `zigbee2mqtt/thermo`: null"
        );
    }

    #[tokio::test]
    async fn devices_are_unavailable_until_their_broker_is_back() {
        let Some(mut broker) = Broker::start() else { return };
        broker.retain("zigbee2mqtt/thermo", r#"{"temperature":20}"#);
        let mut sensor = thermometer(&broker).await;
        until(&mut sensor, |sensor| facts(sensor).contains("(= (temperature lab) 20)")).await;
        broker.kill();
        until(&mut sensor, |sensor| offers(sensor) == 0).await;
        broker.restart();
        until(&mut sensor, |sensor| offers(sensor) == 2).await;
        // The restarted broker has no subscriptions. Messages are lost until the driver has
        // subscribed again.
        let saying = async {
            for degrees in 21.. {
                broker.say("zigbee2mqtt/thermo", &format!(r#"{{"temperature":{degrees}}}"#));
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
        };
        let is_heard = |sensor: &Sensor| !facts(sensor).contains("(= (temperature lab) 20)");
        tokio::select! {
            () = saying => {}
            () = until(&mut sensor, is_heard) => {}
        }
    }

    #[tokio::test]
    async fn invalid_and_missing_values_are_reported_with_a_reason() {
        let Some(broker) = Broker::start() else { return };
        let mut sensor = thermometer(&broker).await;
        let problem = measure(&mut sensor, "temperature").await.expect_err("nothing was said");
        assert_eq!(
            problem.to_string(),
            "receive a value on `zigbee2mqtt/thermo`: nothing was received yet"
        );
        for rubbish in [
            "",
            "{",
            "[]",
            "off",
            "999",
            r#"{"temperature":null}"#,
            r#"{"temperature":"warm"}"#,
            r#"{"temperature":false}"#,
            r#"{"temperature":1e300}"#,
        ] {
            broker.retain("zigbee2mqtt/thermo", rubbish);
            let mut sensor = thermometer(&broker).await;
            let failed = measure(&mut sensor, "temperature").await;
            assert!(failed.is_err(), "{rubbish}: {failed:?}");
        }
        let nowhere = json!({ "location": "lab", "topic": "x", "broker": "127.0.0.1:9" });
        let mut sensor = temperature_sensor(&blueprint_with("mqtt", nowhere)).expect("a sensor");
        sensor.read_state().expect("it may be away").await;
        assert_eq!(offers(&sensor), 0);
        let problem = measure(&mut sensor, "temperature").await.expect_err("nobody is there");
        assert!(problem.to_string().starts_with("reach the broker 127.0.0.1:9: "), "{problem}");
    }

    #[tokio::test]
    async fn motion_is_reported() {
        let Some(broker) = Broker::start() else { return };
        let availability = "zigbee2mqtt/thermo/availability";
        let more = json!({ "quantity": "motion", "availability": availability });
        let mut sensor = sensor(&blueprint_with("mqtt", config(&broker, more))).expect("a sensor");
        sensor.read_state().expect("it may be away").await;
        broker.say("zigbee2mqtt/thermo", r#"{"battery":97}"#);
        broker.retain("zigbee2mqtt/thermo", r#"{"occupancy":true}"#);
        until(&mut sensor, |sensor| facts(sensor).ends_with(" (motion lab)")).await;
        // The motion is unknown while the detector is unavailable.
        broker.retain(availability, "offline");
        until(&mut sensor, |sensor| offers(sensor) == 0).await;
        assert_eq!(facts(&sensor), BLIND);
        broker.retain(availability, "online");
        until(&mut sensor, |sensor| facts(sensor).ends_with(" (motion lab)")).await;
    }

    #[test]
    fn errors_of_an_entry_name_the_correction() {
        for (config, expected) in [
            (json!({}), "driver `mqtt` needs a `topic`, such as \"zigbee2mqtt/thermometer\""),
            (json!({ "topic": "a/+" }), "topic `a/+`: write that of one device, without + and #"),
            (
                json!({ "topic": "a", "broker": "mqtts://x:8883" }),
                "broker `mqtts://x:8883`: name the certificate authorities \
                 to trust: ca = \"/etc/ssl/certs/ca-certificates.crt\", or your own",
            ),
            (
                json!({ "topic": "a", "json": "temperature" }),
                "json = \"temperature\": write a JSON pointer, such as \"/main/temp\"",
            ),
            (
                json!({ "topic": "a", "broker": "x:many" }),
                "broker `x:many`: its port is no number from 1 to 65535; write HOST:PORT",
            ),
        ] {
            let mut config = config;
            config["location"] = json!("lab");
            let built = temperature_sensor(&blueprint_with("mqtt", config));
            let problem = built.err().map(|error| error.to_string()).unwrap_or_default();
            assert_eq!(problem, format!("build `s`: {expected}"));
        }
    }
}
