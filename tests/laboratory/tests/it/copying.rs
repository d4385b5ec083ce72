//! Journals that copy records of each other: a Journal whose disk does not keep up copies them later,
//! and one record that it cannot keep hinders no other one.

use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use acl::content::{Record, Request, StoreRecords, Version, value};
use acl::{ConversationId, DaemonId, EcosystemId, Performative, Protocol};
use agent::{
    Agent, AgentSettings, Blueprint, Callbacks, Context, ExchangeOpening, Host, HostServices,
    MachineSimulation, MessageRouter, Resource, Resources,
};
use journal::MemoryStore;
use serde_json::json;
use substrate::ResourceQuery;
use substrate::memory::Network;

use crate::house::sayer::PATIENCE;
use crate::house::{launch, name};

/// How long the disk needs for one access.
const SLOW: Duration = Duration::from_secs(1);

/// More requests than a Journal queues beside a write, in requests of each of some agents.
const FLOODERS: usize = 12;
const REQUESTS: usize = 30;

/// A machine with a slow disk.
struct SlowMachine;

impl MachineSimulation for SlowMachine {
    fn wall_clock(&self) -> SystemTime {
        UNIX_EPOCH + Duration::from_secs(1_789_997_600)
    }

    fn work_duration(&self) -> Duration {
        SLOW
    }
}

/// A Journal with these records, which does not change.
struct OtherJournal(Vec<Record>);

impl Agent for OtherJournal {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn answer_query(&mut self, resource: Resource, _: &mut Context<Self>) -> Option<String> {
        (resource == Resource::Journal).then(|| serde_json::to_string(&self.0).expect("JSON"))
    }
}

/// Agent that requests to keep many records, each in a request of its own.
struct Flooder(usize);

impl Agent for Flooder {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        for number in 0..REQUESTS {
            let records = vec![record(&format!("goal/{}-{number}", self.0), json!("asked for"))];
            let opening = ExchangeOpening {
                to: Some(name("journal")),
                performative: Performative::Request,
                protocol: Protocol::StateChange,
                conversation: ConversationId::new(&format!("{}-{number}", self.0)),
                content: value(&Request::StoreRecords(StoreRecords { records })),
            };
            ctx.open(opening, PATIENCE, |_: &mut Flooder, _, _| ());
        }
    }
}

fn record(key: &str, body: serde_json::Value) -> Record {
    Record { key: key.to_owned(), version: Version { term: 1, count: 1 }, body }
}

fn machine(network: &Network, daemon: &str) -> Arc<MessageRouter> {
    let services = HostServices::simulated(Arc::new(SlowMachine), None);
    let daemon = DaemonId::new(daemon).expect("a name");
    let ecosystem = EcosystemId::new("home").expect("a name");
    let settings = AgentSettings::default();
    let machine = MessageRouter::on(services, ecosystem, daemon.clone(), settings);
    machine.connect(network.open(daemon, Arc::<MessageRouter>::clone(&machine) as _));
    machine
}

/// Creates a machine with a Journal whose file is open.
async fn journal_on(network: &Network) -> Arc<MessageRouter> {
    let here = machine(network, "here");
    let domain = pddl::parse_domain("(define (domain d))").into_result().expect("a domain");
    let map = pddl::parse_problem("(define (problem p) (:domain d) (:init) (:goal (and)))");
    let map = map.into_result().expect("a map");
    let mut resources = Resources::default();
    resources.insert(MemoryStore::default());
    let journals = vec![name("journal"), name("other-journal")];
    let host = Arc::new(Host { journals, resources, ..Host::new(domain, map) });
    let (id, config) = (name("journal"), json!({}).into());
    let blueprint = Blueprint { id, driver: String::new(), config, host };
    let journal = (journal::PLUGIN.build)(blueprint).expect("built");
    drop(launch(journal, "journal", &here, false));
    tokio::time::sleep(SLOW * 2).await;
    here
}

/// Returns the keys of the records that the Journal keeps.
async fn kept(here: &Arc<MessageRouter>) -> Vec<String> {
    let ask = ResourceQuery {
        daemon: Some(here.daemon().clone()),
        resource: Resource::Journal,
        agent: Some(name("journal")),
    };
    let answers = here.ask(ask, PATIENCE).await;
    let read = |answer| serde_json::from_slice::<Vec<Record>>(answer).expect("records");
    answers.iter().flat_map(|answer| read(answer)).map(|record| record.key).collect()
}

#[tokio::test(start_paused = true)]
async fn a_journal_under_load_copies_the_records_of_another_later() {
    let network = Network::new();
    let here = journal_on(&network).await;
    let there = machine(&network, "there");
    for number in 0..FLOODERS {
        let id = format!("flooder-{number}");
        drop(launch(Box::new(Flooder(number)), &id, &there, false));
        // The mailbox has room for those of some agents only.
        tokio::time::sleep(SLOW / 50).await;
    }
    // The first write runs, and as many requests as can wait do so.
    tokio::time::sleep(SLOW / 2).await;
    let other = OtherJournal(vec![record("goal/copied", json!("asked for"))]);
    drop(launch(Box::new(other), "other-journal", &there, false));
    tokio::time::sleep(SLOW * 10).await;
    let kept = kept(&here).await;
    assert!(kept.len() > 256, "the queue was not full: {}", kept.len());
    assert!(kept.iter().any(|key| key == "goal/copied"), "{} records", kept.len());
}

#[tokio::test(start_paused = true)]
async fn a_record_that_cannot_be_kept_hinders_no_other() {
    let network = Network::new();
    let here = journal_on(&network).await;
    let there = machine(&network, "there");
    let other = OtherJournal(vec![record("", json!(0)), record("goal/copied", json!("asked for"))]);
    drop(launch(Box::new(other), "other-journal", &there, false));
    tokio::time::sleep(SLOW * 10).await;
    assert_eq!(kept(&here).await, ["goal/copied"]);
}
