//! A gateway to an MQTT broker: the time from a device's message to a fact in the composite domain,
//! and the discovery of hundreds of devices at once.
//!
//! ```text
//! apt-get install mosquitto
//! cargo bench -p althing --bench gateway
//! ```
//!
//! A real broker, a real daemon with a gateway and a Domain Maintainer, and a client of each. The
//! first clock runs from the message to the broker until the Domain Maintainer, queried repeatedly
//! over Zenoh, has the fact; each device sends five messages a second, more than real devices do
//! for long. The second clock runs from the one text in which Zigbee2MQTT lists all its devices
//! until all of them are present, and until they can be planned with.

#[path = "../../../../tests/support/broker.rs"]
#[allow(dead_code, reason = "what tests need of a broker besides")]
mod broker;
mod support;

use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::content::BelievedState;
use acl::{AgentId, DaemonId, EcosystemId};
use agent::{AgentSettings, MessageRouter, Resource, ResourceQuery};
use mqtt_link::BrokerConnection;
use serde_json::{Value, json};
use substrate_zenoh::Config;
use support::{Figures, Machine, Outcome, PATIENCE};

/// Number of thermometers in the building, and of their messages.
const HOUSE: usize = 40;
const WORDS: usize = 2_000;
const WORD_MS: f64 = 10.0;

/// Time between two messages of all devices together.
const BETWEEN: Duration = Duration::from_millis(5);

/// Number of devices that are announced at once, and of rounds.
const CROWD: usize = 500;
const ROUNDS: usize = 10;
const CROWD_MS: f64 = 2_000.0;

const ONTOLOGY: &str = include_str!("../../../../domains/smart-office/domain.pddl");
const MAP: &str = include_str!("../../../../domains/smart-office/map.pddl");
const TOPIC: &str = "zigbee2mqtt/bridge/devices";

#[tokio::main]
async fn main() -> Outcome<()> {
    let Some(broker) = broker::Broker::start() else { return Ok(()) };
    let machine = Machine::new()?;
    std::fs::write(machine.path().join("domain.pddl"), ONTOLOGY)?;
    std::fs::write(machine.path().join("map.pddl"), MAP)?;
    let file = format!(
        "[ecosystem]\nname = \"gateway\"\ndomain = \"domain.pddl\"\nproblem = \"map.pddl\"\n\n\
         [[agent]]\nname = \"domain-maintainer\"\nplugin = \"domain-maintainer\"\ndaemon = \"d\"\n\n\
         [[agent]]\nname = \"zigbee\"\nplugin = \"mqtt\"\ndaemon = \"d\"\n\
         config = {{ broker = \"{}\" }}\n",
        broker.name()
    );
    std::fs::write(&machine.file, file)?;
    let mut process = machine.start("d", "decentralized")?;
    process.ready().await?;
    let client = Client::enter(&machine, &broker.name()).await?;
    client.words().await?;
    client.crowd().await?;
    support::reached()
}

/// A client that receives messages on Zenoh, and publishes messages of devices on MQTT.
struct Client {
    router: Arc<MessageRouter>,
    device: Arc<BrokerConnection>,
}

impl Client {
    async fn enter(machine: &Machine, broker: &str) -> Outcome<Client> {
        let mut config = Config::new(EcosystemId::new("gateway")?, DaemonId::new("listener")?);
        config.mode = substrate_zenoh::SessionMode::Client;
        config.connect = vec![machine.endpoint("gateway", "d")];
        let (ecosystem, daemon) = (config.ecosystem.clone(), config.daemon.clone());
        let router = MessageRouter::new(ecosystem, daemon, AgentSettings::default());
        router.connect(config.open(Arc::<MessageRouter>::clone(&router)).await?);
        let broker = mqtt_link::Broker::new(Some(broker), None, None, None)?;
        let device = BrokerConnection::shared(&broker, "bench");
        let mut trouble = device.problem();
        tokio::time::timeout(PATIENCE, trouble.wait_for(Option::is_none)).await??;
        Ok(Client { router, device })
    }

    /// Measures the time from a device's message to a fact.
    async fn words(&self) -> Outcome<()> {
        let words = if support::is_whole() { WORDS } else { 5 };
        self.announce(HOUSE)?;
        self.await_offers(HOUSE).await?;
        let mut took = Figures::new();
        let mut next = tokio::time::interval(BETWEEN);
        for word in 0..words {
            next.tick().await;
            let device = word % HOUSE;
            // A value that was never sent before.
            let celsius = f64::from(1_000 + u32::try_from(word)?) / 100.0;
            let fact = format!("(= (temperature office1) {celsius})");
            let began = Instant::now();
            let text = json!({ "temperature": celsius, "linkquality": 80 }).to_string();
            self.say(&format!("zigbee2mqtt/office1-t{device}"), &text)?;
            self.await_fact(&fact).await?;
            took.push(began.elapsed());
        }
        took.tell(&format!("a device's word → a fact, {words} times, {HOUSE} devices"));
        support::judge("p99", took.within(0.99), WORD_MS);
        Ok(())
    }

    /// Measures the discovery of hundreds of devices at once.
    async fn crowd(&self) -> Outcome<()> {
        let (rounds, crowd) = if support::is_whole() { (ROUNDS, CROWD) } else { (1, 20) };
        let (mut present, mut offered) = (Figures::new(), Figures::new());
        let mut epochs = Vec::new();
        for _ in 0..rounds {
            self.announce(0)?;
            self.await_offers(0).await?;
            let before = self.epoch().await?;
            let began = Instant::now();
            self.announce(crowd)?;
            self.await_present(crowd).await?;
            present.push(began.elapsed());
            self.await_offers(crowd).await?;
            offered.push(began.elapsed());
            epochs.push(self.epoch().await? - before);
        }
        present.tell(&format!("{crowd} devices told of at once → all present, {rounds} times"));
        support::judge("slowest", present.within(1.0), CROWD_MS);
        offered.tell("… → all of them can be planned with");
        println!("    epochs of each burst: {epochs:?}");
        Ok(())
    }

    fn say(&self, topic: &str, text: &str) -> Outcome<()> {
        Ok(self.device.publish_text(topic, text)?)
    }

    fn announce(&self, devices: usize) -> Outcome<()> {
        let thermometer = |number: usize| -> Value {
            let name = format!("office1-t{number}");
            json!({ "ieee_address": format!("0x{number:016x}"), "type": "EndDevice",
                "friendly_name": name, "definition": { "exposes": [
                    { "type": "numeric", "name": "temperature", "property": "temperature",
                      "unit": "°C", "access": 1 } ] } })
        };
        self.say(TOPIC, &json!((0..devices).map(thermometer).collect::<Vec<_>>()).to_string())
    }

    async fn await_fact(&self, fact: &str) -> Outcome<()> {
        let deadline = Instant::now() + PATIENCE;
        let agent = AgentId::new("domain-maintainer").ok();
        while Instant::now() < deadline {
            let ask =
                ResourceQuery { daemon: None, resource: Resource::State, agent: agent.clone() };
            let answers = self.router.ask(ask, PATIENCE).await;
            let state: Option<BelievedState> =
                answers.first().and_then(|answer| serde_json::from_slice(answer).ok());
            if state.is_some_and(|state| state.facts.iter().any(|one| one.fact == fact)) {
                return Ok(());
            }
        }
        Err(format!("{fact} was waited for in vain").into())
    }

    async fn await_present(&self, devices: usize) -> Outcome<()> {
        let deadline = Instant::now() + PATIENCE;
        let (mut directory, mut changes) = self.router.presence_changes();
        let is_device = |agent: &AgentId| agent.as_str().starts_with("office1-t");
        while directory.iter().filter(|resident| is_device(&resident.agent)).count() < devices {
            let left = deadline.saturating_duration_since(Instant::now());
            tokio::time::timeout(left, changes.recv()).await??;
            directory = self.router.directory();
        }
        Ok(())
    }

    async fn await_offers(&self, devices: usize) -> Outcome<()> {
        let deadline = Instant::now() + PATIENCE;
        let maintainer = AgentId::new("domain-maintainer").ok();
        while Instant::now() < deadline {
            let domain = support::domains(&self.router, maintainer.clone()).await.pop();
            if domain.is_some_and(|domain| domain.offers.len() == devices) {
                return Ok(());
            }
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        Err(format!("{devices} devices were waited for in vain").into())
    }

    async fn epoch(&self) -> Outcome<u64> {
        let maintainer = AgentId::new("domain-maintainer").ok();
        let domain = support::domains(&self.router, maintainer).await.pop();
        Ok(domain.ok_or("no Domain Maintainer answers")?.epoch)
    }
}
