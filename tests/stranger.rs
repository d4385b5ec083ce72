//! Messages as an independent tool receives them on Zenoh (`althing/**`): the performatives of
//! Table 1 in an order that the protocols allow, a local domain of each bidder, and no plan with
//! other agents' actions.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Bid, Snapshot};
use acl::{AgentId, DaemonId, EcosystemId, Message, Performative, ReplyToken};
use conversation::Exchange;
use substrate::{
    Delivery, Inbound, Presence, ReceivedQuery, Resource, ResourceQuery, Substrate as _,
};
use substrate_zenoh::{Config, SessionMode};
use tokio::sync::mpsc;

use crate::support::{Office, PATIENCE, stderr, stdout};

const DAEMONS: [&str; 5] =
    ["reasoning", "conf-room-pi", "office1-pi", "office2-pi", "turtlebot-laptop"];

const ROBOT: &str = "turtlebot-1";
/// Agent that the robot carries; its actions may be in the robot's plans.
const CARRIED: &str = "ir-1";

fn stranger(office: &Office, name: &str) -> Config {
    let ecosystem = EcosystemId::new("smart-office").expect("a name");
    let mut config = Config::new(ecosystem, DaemonId::new(name).expect("a name"));
    config.mode = SessionMode::Client;
    let socket = office.runtime_folder().join("smart-office/reasoning.sock");
    config.connect = vec![format!("unixsock-stream/{}", socket.display())];
    config
}

/// Requests the temperatures while an independent client listens; returns all messages up to the
/// goal's final report.
async fn listen(office: &Office) -> Vec<Message> {
    let (tell, mut heard) = mpsc::unbounded_channel();
    let _tap = substrate_zenoh::tap(stranger(office, "stranger"), move |_, message| {
        let _ = tell.send(message.payload);
    })
    .await
    .expect("the ecosystem runs");
    let file = Office::file().display().to_string();
    let asking = office.command(&["goal", "temperatures", "--ecosystem", &file]).output();
    let output = tokio::task::spawn_blocking(|| asking).await.expect("no panic").expect("it runs");
    assert!(output.status.success(), "{}{}", stdout(&output), stderr(&output));
    let mut messages = Vec::new();
    // Reads up to a heartbeat after the final report: all earlier messages have arrived by then.
    let mut is_over = false;
    loop {
        let payload = tokio::time::timeout(PATIENCE, heard.recv()).await.expect("heartbeats come");
        let Ok(message) = acl::decode(&payload.expect("the tap lives")) else { continue };
        let sender = message.sender.as_str();
        let is_beat = message.performative == Performative::Inform && sender == ROBOT;
        if is_over && is_beat {
            return messages;
        }
        is_over |= sender == "plan-requester" && message.content["outcome"] == "done";
        messages.push(message);
    }
}

/// Returns the exchanges that violate their protocols.
///
/// A lost message is received later, when it is repeated. Therefore the messages of each side are
/// sorted by the sender's numbering. An answer may overtake the message that it answers on the way
/// to the listener. Therefore an exchange is correct if *some* order of both sides is allowed.
fn disorder(messages: &[Message]) -> Vec<String> {
    let mut disorder = Vec::new();
    let mut ids = BTreeSet::new();
    let mut exchanges: BTreeMap<&ReplyToken, Vec<&Message>> = BTreeMap::new();
    for message in messages.iter().filter(|message| ids.insert(&message.id)) {
        if let (Some(token), Some(_)) = (message.exchange(), message.protocol) {
            exchanges.entry(token).or_default().push(message);
        }
    }
    for turns in exchanges.values_mut() {
        turns.sort_by_key(|turn| spoken(turn));
        let opening = turns.iter().find(|turn| turn.opens_exchange());
        let Some(opening) = opening else { continue };
        let (initiator, protocol) = (&opening.sender, opening.protocol.expect("filtered"));
        let of = |turn: &&&Message| turn.sender == *initiator;
        let participants: BTreeSet<_> =
            turns.iter().filter(|turn| !of(turn)).map(|turn| &turn.sender).collect();
        for participant in participants {
            let ours: Vec<_> = turns
                .iter()
                .filter(of)
                .filter(|turn| turn.receiver.is_empty() || turn.receiver.contains(participant))
                .collect();
            let theirs: Vec<_> = turns.iter().filter(|turn| turn.sender == *participant).collect();
            let exchange = Exchange::new(protocol, initiator.clone(), opening.incarnation);
            if !is_allowed(&exchange, &ours, &theirs) {
                let lines: Vec<_> = turns.iter().map(|turn| line(turn)).collect();
                disorder.push(format!("{protocol:?} with {participant}: {lines:#?}"));
            }
        }
    }
    disorder
}

/// Returns a message's number among all messages of its sender; the identifier ends with it.
fn spoken(message: &Message) -> u64 {
    let number = message.id.as_str().rsplit('.').next();
    number.and_then(|number| number.parse().ok()).expect("an agent numbers its messages")
}

/// Whether some order of both sides' messages is allowed.
fn is_allowed(exchange: &Exchange, ours: &[&&Message], theirs: &[&&Message]) -> bool {
    let goes_on = |first: &Message, ours: &[&&Message], theirs: &[&&Message]| {
        let mut next = exchange.clone();
        next.advance(first).is_ok() && is_allowed(&next, ours, theirs)
    };
    match (ours, theirs) {
        ([], []) => true,
        _ => {
            ours.split_first().is_some_and(|(first, rest)| goes_on(first, rest, theirs))
                || theirs.split_first().is_some_and(|(first, rest)| goes_on(first, ours, rest))
        }
    }
}

fn said(messages: &[Message]) -> BTreeSet<&'static str> {
    messages.iter().map(|message| message.performative.as_str()).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_decentralized_flow() {
    let mut office = Office::new();
    office.up(&DAEMONS, &["--mode", "decentralized"]);
    await_offers(&office, 4).await;

    let messages = listen(&office).await;

    assert_eq!(disorder(&messages), [""; 0]);
    let unasked: Vec<_> = messages
        .iter()
        .filter(|message| message.performative != Performative::Agree)
        .cloned()
        .collect();
    assert_ne!(disorder(&unasked), [""; 0], "who was chosen must have bid: the check can fail");
    let said = said(&messages);
    for act in ["inform", "request", "cfp", "agree", "accept-proposal", "confirm"] {
        assert!(said.contains(act), "{act} was not heard in {said:?}");
    }
    assert!(!said.contains("propose"), "the central planner was not asked");
    check_bids(&messages);
    check_domains(&office, &messages).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_centralized_flow() {
    let mut office = Office::new();
    office.up(&DAEMONS, &["--mode", "centralized"]);
    await_offers(&office, 4).await;

    let messages = listen(&office).await;

    assert_eq!(disorder(&messages), [""; 0]);
    let said = said(&messages);
    for act in ["inform", "request", "propose", "accept-proposal", "agree", "confirm"] {
        assert!(said.contains(act), "{act} was not heard in {said:?}");
    }
    assert!(!said.contains("cfp"), "nobody was called for proposals");
}

/// Returns sender, receivers and content of a message, to diagnose a failure.
fn line(message: &Message) -> String {
    let Message { performative, sender, receiver, content, .. } = message;
    let receivers: Vec<_> = receiver.iter().map(AgentId::as_str).collect();
    format!("{sender} → {}: {performative} {content}", receivers.join(", "))
}

/// Checks that every proposal uses only actions of the bidder and of agents that it carries.
fn check_bids(messages: &[Message]) {
    let mut bidders = 0;
    for message in messages {
        let Ok(bid) = message.content_as::<Bid>() else { continue };
        bidders += 1;
        let bidder = message.sender.as_str();
        for proposal in &bid.proposals {
            let plan = pddl::parse_plan(&proposal.plan).into_result().expect("a plan");
            for step in &plan.steps {
                let actor = step.arguments.first().expect("an agent").as_str();
                let is_own = actor == bidder || (bidder == ROBOT && actor == CARRIED);
                assert!(is_own, "`{bidder}` plans for `{actor}`: {step}");
            }
        }
    }
    let heard: Vec<_> = messages.iter().map(line).collect();
    assert!(bidders >= 3, "two thermometers and the robot bid, not {bidders}: {heard:#?}");
}

/// Checks that every bidder planned in a local domain, without the actions of other agents.
async fn check_domains(office: &Office, messages: &[Message]) {
    let mut digests = BTreeMap::new();
    for message in messages {
        if let Ok(bid) = message.content_as::<Bid>() {
            digests.insert(message.sender.clone(), bid.domain_digest);
        }
    }
    let distinct: BTreeSet<_> = digests.values().collect();
    assert_eq!(distinct.len(), digests.len(), "{digests:?}");
    for bidder in digests.keys() {
        let snapshot = ask_domain(office, bidder).await;
        let offering: Vec<_> = snapshot.offers.keys().map(AgentId::as_str).collect();
        let own: &[&str] =
            if bidder.as_str() == ROBOT { &[CARRIED, ROBOT] } else { &[bidder.as_str()] };
        assert_eq!(offering, own, "the local domain of `{bidder}`");
    }
}

/// A client that only sends queries.
struct Deaf;

impl Inbound for Deaf {
    fn deliver(&self, _: Delivery) {}
    fn presence(&self, _: Presence) {}
    fn receive_query(&self, _: ReceivedQuery) {}
}

async fn ask_domain(office: &Office, agent: &AgentId) -> Snapshot {
    let config = stranger(office, "asker");
    let session = config.open(Arc::new(Deaf)).await.expect("the ecosystem runs");
    let ask =
        ResourceQuery { daemon: None, resource: Resource::Domain, agent: Some(agent.clone()) };
    let deadline = tokio::time::Instant::now() + PATIENCE;
    loop {
        // Zenoh answers a query with nothing as long as it knows no agent that could answer.
        let answers = session.ask(ask.clone(), Duration::from_secs(5)).await;
        if let Some(answer) = answers.first() {
            return serde_json::from_slice(answer).expect("a snapshot");
        }
        assert!(tokio::time::Instant::now() < deadline, "`{agent}` does not answer");
    }
}

/// Waits until `count` agents can be planned with.
async fn await_offers(office: &Office, count: usize) {
    let maintainer = AgentId::new("domain-maintainer").expect("a name");
    let deadline = tokio::time::Instant::now() + PATIENCE;
    while ask_domain(office, &maintainer).await.offers.len() < count {
        assert!(tokio::time::Instant::now() < deadline, "not all agents came");
    }
}
