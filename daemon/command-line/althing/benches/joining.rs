//! Plug and play: the time from the launch of an agent until all others can plan with it.
//!
//! ```text
//! cargo bench -p althing --bench joining
//! ```
//!
//! The smart office runs in a process of its own. An unknown thermometer is launched
//!
//! - in a daemon that is present already, a hundred times;
//! - with a daemon of its own, a new process and a new router. A daemon connects to those that
//!   entered earlier, so its name must not matter; names at both ends of the alphabet are measured;
//! - with a daemon that was killed and is restarted at once.
//!
//! The clock stops when every maintainer has been queried, and has answered that it knows the
//! newcomer: the Domain Maintainer and the newcomer itself plan with it, and the domains of all
//! others contain it. The announcement of the Domain Maintainer comes earlier, and is reported,
//! too.

mod support;

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::content::{EpochChange, Inform};
use acl::{AgentId, DaemonId, EcosystemId, Message, Performative};
use agent::{Agent, Callbacks, Context, Host, MessageRouter};
use building::{BuildingHandle, Layout};
use support::{Entry, Figures, Machine, Outcome, PATIENCE, Process};
use tokio::sync::mpsc;

const AGENTS: usize = 100;
const AGENT_AIM_MS: f64 = 30.0;

/// Numbers of daemons that join: `LAST` with names that sort after all other names, and `FIRST`
/// with names that sort before.
const LAST: usize = 25;
const FIRST: usize = 25;
const DAEMON_AIM_MS: f64 = 150.0;

/// Pause before each router joins. A router that joins within 100 ms after another has left may get
/// the place of that one among Zenoh's routes; the benchmark measures routers that join an
/// ecosystem at rest.
const REST: Duration = Duration::from_millis(300);

const ECOSYSTEM: &str = "smart-office";
const OFFICE: &str = include_str!("../../../../ecosystems/smart-office.toml");
const DOMAIN: &str = ontology::STANDARD_DOMAIN;

/// The office's plugins of actuators: each of their agents has a domain of its own.
const DEVICES: [&str; 5] =
    ["temperature-sensor", "sensor", "ir-temperature-sensor", "turtlebot", "ptz-camera"];

/// Names of the two daemons: `HOUSE` hosts the office in a process of its own; `HERE` is in the
/// process of the benchmark, and connects to `HOUSE`.
const HOUSE: &str = "house";
const HERE: &str = "stand";

/// Maximum number of announcements that wait to be read; further ones are lost.
const HEARD_MAX: usize = 256;

#[tokio::main]
async fn main() -> Outcome<()> {
    let of = |count: usize| if support::is_whole() { count } else { 1 };
    let counts = [("newcomer", of(AGENTS)), ("wing", of(LAST)), ("annex", of(FIRST))];
    let mut bench = Bench::open(&counts).await?;
    bench.agents(counts[0].1).await?;
    for (house, count) in &counts[1..] {
        bench.daemons(house, *count).await?;
    }
    for (house, count) in &counts[1..] {
        bench.returns(house, *count).await?;
    }
    support::reached()
}

/// The office in a process of its own, and a daemon in this process that observes it.
struct Bench {
    machine: Machine,
    router: Arc<MessageRouter>,
    host: Arc<Host>,
    changes: mpsc::Receiver<(Instant, EpochChange)>,
    /// The agents with a domain of their own, without newcomers and the Domain Maintainer.
    devices: BTreeSet<String>,
    _office: Process,
}

impl Bench {
    async fn open(counts: &[(&str, usize)]) -> Outcome<Bench> {
        let machine = Machine::new()?;
        let text = ecosystem(counts);
        std::fs::write(&machine.file, &text)?;
        let mut office = machine.start(HOUSE, "decentralized")?;
        office.ready().await?;

        // The map of the office's file is that of the building of seed 0.
        let map = Layout::seeded(0).layout.map_pddl(ontology::STANDARD_NAME);
        let (ecosystem, here) = (EcosystemId::new(ECOSYSTEM)?, DaemonId::new(HERE)?);
        let mut host = support::host(DOMAIN, &map, agent::Mode::Decentralized)?;
        host.resources.insert(BuildingHandle::connect(machine.building()).await?);
        let settings = host.settings.clone();
        let router = MessageRouter::new(ecosystem.clone(), here.clone(), settings);
        let mut config = substrate_zenoh::Config::new(ecosystem, here);
        config.connect = vec![machine.endpoint(ECOSYSTEM, HOUSE)];
        router.connect(config.open(Arc::<MessageRouter>::clone(&router)).await?);
        let (tell, changes) = mpsc::channel(HEARD_MAX);
        let ear = Box::new(Ear { tell });
        support::launch(&AgentId::new("ear")?, ear, &router, ontology::STANDARD_NAME);

        let is_device = |entry: &Entry| DEVICES.contains(&&*entry.plugin) && entry.daemon == HOUSE;
        let devices: BTreeSet<_> = support::entries(&text)?
            .into_iter()
            .filter(is_device)
            .map(|entry| entry.name.to_string())
            .collect();
        support::await_offers(&router, &devices).await?;
        let host = Arc::new(host);
        Ok(Bench { machine, router, host, changes, devices, _office: office })
    }

    /// Measures new agents in this process's daemon, one after the other.
    async fn agents(&mut self, count: usize) -> Outcome<()> {
        let (mut announced, mut known) = (Figures::default(), Figures::default());
        for number in 0..count {
            let entry = newcomer("newcomer", number)?;
            let begun = Instant::now();
            let agent = support::build(&sensor::TEMPERATURE_SENSOR, &entry, &self.host)?;
            let task = support::launch(&entry.name, agent, &self.router, ontology::STANDARD_NAME);
            announced.push(self.joined(&entry.name).await? - begun);
            known.push(self.known_to_all(&entry.name).await? - begun);
            task.abort();
            self.left(&entry.name).await?;
        }
        println!("a new agent in a running daemon, {count} times");
        announced.tell("launched to announced");
        known.tell("launched to plannable in every maintainer");
        support::judge("p99", known.within(0.99), AGENT_AIM_MS);
        Ok(())
    }

    /// Measures new daemons with one agent each, one after the other.
    async fn daemons(&mut self, house: &str, count: usize) -> Outcome<()> {
        let mut figures = [const { Figures::new() }; 3];
        for number in 0..count {
            let name = newcomer(house, number)?.name;
            let begun = Instant::now();
            let mut process = self.machine.start(&daemon_of(house, number), "decentralized")?;
            process.ready().await?;
            figures[0].push(begun.elapsed());
            figures[1].push(self.joined(&name).await? - begun);
            figures[2].push(self.known_to_all(&name).await? - begun);
            process.kill()?;
            process.ended().await?;
            self.left(&name).await?;
            tokio::time::sleep(REST).await;
        }
        println!("a new daemon called `{house}`, {count} times");
        figures[0].tell("started to ready");
        figures[1].tell("started to announced");
        figures[2].tell("started to plannable in every maintainer");
        support::judge("p50", figures[2].within(0.5), DAEMON_AIM_MS);
        Ok(())
    }

    /// Measures daemons that are killed and restarted at once.
    async fn returns(&mut self, house: &str, count: usize) -> Outcome<()> {
        let mut figures = [const { Figures::new() }; 2];
        for number in 0..count {
            let (name, daemon) = (newcomer(house, number)?.name, daemon_of(house, number));
            let mut process = self.machine.start(&daemon, "decentralized")?;
            self.joined(&name).await?;
            process.kill()?;
            process.ended().await?;
            let begun = Instant::now();
            let mut process = self.machine.start(&daemon, "decentralized")?;
            self.left(&name).await?;
            self.joined(&name).await?;
            figures[0].push(self.known_to_all(&name).await? - begun);
            figures[1].push(self.knows_all(&name).await? - begun);
            process.kill()?;
            process.ended().await?;
            self.left(&name).await?;
            tokio::time::sleep(REST).await;
        }
        println!("the daemon `{house}`, killed and started again at once, {count} times");
        figures[0].tell("started again to plannable in every maintainer");
        figures[1].tell("started again until it knows everyone");
        Ok(())
    }

    /// Returns the time at which the Domain Maintainer announced that this agent had joined.
    async fn joined(&mut self, name: &AgentId) -> Outcome<Instant> {
        self.heard(|change| change.joined.contains(name)).await
    }

    async fn left(&mut self, name: &AgentId) -> Outcome<Instant> {
        self.heard(|change| change.left.contains(name)).await
    }

    async fn heard(&mut self, what: impl Fn(&EpochChange) -> bool) -> Outcome<Instant> {
        loop {
            let heard = tokio::time::timeout(PATIENCE, self.changes.recv()).await?;
            let (at, change) = heard.ok_or("the listener has ended")?;
            if what(&change) {
                return Ok(at);
            }
        }
    }

    /// Returns the time at which all maintainers had answered that they know this agent.
    async fn known_to_all(&self, name: &AgentId) -> Outcome<Instant> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let domains = support::domains(&self.router, None).await;
            let know = domains.iter().filter(|domain| domain.problem.contains(name.as_str()));
            let plan = domains.iter().filter(|domain| domain.offers.contains_key(name));
            // Its own maintainer and the Domain Maintainer plan with it.
            if know.count() == self.devices.len() + 2 && plan.count() == 2 {
                return Ok(Instant::now());
            }
            if Instant::now() > deadline {
                return Err(format!("not all maintainers came to know `{name}`").into());
            }
        }
    }

    /// Returns the time at which this agent had answered that it knows all devices of the office.
    async fn knows_all(&self, name: &AgentId) -> Outcome<Instant> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let domains = support::domains(&self.router, Some(name.clone())).await;
            let knows = |device: &String| domains[0].problem.contains(&**device);
            if domains.len() == 1 && self.devices.iter().all(knows) {
                return Ok(Instant::now());
            }
            if Instant::now() > deadline {
                return Err(format!("`{name}` did not come to know everyone").into());
            }
        }
    }
}

/// Receives the announcements of the Domain Maintainer.
struct Ear {
    tell: mpsc::Sender<(Instant, EpochChange)>,
}

impl Agent for Ear {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on_broadcast(Performative::Inform, Self::informed)
    }
}

impl Ear {
    fn informed(&mut self, message: Message, _ctx: &mut Context<Self>) {
        if let Ok(Inform::Epoch(change)) = message.content_as::<Inform>() {
            // An announcement that does not fit is lost; the wait for it then ends with an error.
            let _ = self.tell.try_send((Instant::now(), change));
        }
    }
}

// === the ecosystem ===

/// Returns the office's file for one machine, with thermometers that are launched later.
fn ecosystem(counts: &[(&str, usize)]) -> String {
    let lines = OFFICE.lines().map(|line| match line.split_once(" = ") {
        Some(("daemon", _)) => format!("daemon = \"{HOUSE}\"\n"),
        Some(("reasoning", _)) => format!("reasoning = \"{HOUSE}\"\n"),
        _ => format!("{line}\n"),
    });
    let mut text: String = lines.collect();
    for (house, count) in counts {
        for number in 0..*count {
            let (name, daemon) = (name_of(house, number), daemon_of(house, number));
            let _ = write!(
                text,
                "\n[[agent]]\nname = \"{name}\"\nplugin = \"temperature-sensor\"\n\
                 daemon = \"{daemon}\"\nconfig = {{ location = \"office1\" }}\n"
            );
        }
    }
    text
}

/// Returns a name that is not the beginning of another name.
fn name_of(house: &str, number: usize) -> String {
    format!("thermometer-{house}-{number:03}")
}

fn daemon_of(house: &str, number: usize) -> String {
    if house == "newcomer" { HERE.to_owned() } else { format!("{house}-{number:03}") }
}

fn newcomer(house: &str, number: usize) -> Outcome<Entry> {
    Ok(Entry {
        name: AgentId::new(&name_of(house, number))?,
        plugin: sensor::TEMPERATURE_SENSOR.name.to_owned(),
        daemon: daemon_of(house, number),
        config: serde_json::json!({ "location": "office1" }),
    })
}
