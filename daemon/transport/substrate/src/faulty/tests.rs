//! Tests of the faulty substrate: the faults occur, and the same seed always has the same results.

use super::*;
use crate::Resource;
use crate::recording_inbound::{RecordingInbound, agent, daemon};

type End = Arc<dyn Substrate>;

/// Connects two daemons, `a` and `b`, each with a record of what it receives.
fn pair(network: &Network) -> (End, Arc<RecordingInbound>, End, Arc<RecordingInbound>) {
    let (a, b) = (RecordingInbound::new(), RecordingInbound::new());
    let port_a = network.open(daemon("a"), Arc::<RecordingInbound>::clone(&a) as _);
    let port_b = network.open(daemon("b"), Arc::<RecordingInbound>::clone(&b) as _);
    (port_a, a, port_b, b)
}

/// Sends a hundred messages from `a` to `b`; returns the messages that `b` receives.
async fn hundred(seed: u64, weather: LinkConditions) -> Vec<String> {
    let network = Network::new(seed);
    let (port, _, _, ear) = pair(&network);
    network.set_conditions(weather);
    for number in 0..100 {
        let to = AgentAddress { daemon: daemon("b"), agent: agent("robot") };
        port.send(&to, Subject::Receipt, Bytes::from(number.to_string())).expect("open");
    }
    tokio::time::sleep(Duration::from_secs(1)).await;
    let words = ear.take_lines().into_iter();
    words.map(|word| word.trim_start_matches("robot Receipt ").to_owned()).collect()
}

#[tokio::test(start_paused = true)]
async fn good_links_keep_the_order_and_lose_nothing() {
    let all: Vec<_> = (0..100).map(|number| number.to_string()).collect();
    assert_eq!(hundred(1, LinkConditions::good()).await, all);
}

#[tokio::test(start_paused = true)]
async fn faults_are_the_same_for_the_same_seed() {
    let storm =
        LinkConditions { loss: 0.2, doubled: 0.2, overtaken: 0.2, ..LinkConditions::good() };
    let heard = hundred(7, storm.clone()).await;
    let kinds: BTreeSet<_> = heard.iter().collect();
    assert!(kinds.len() < 90, "some are lost: {}", kinds.len());
    assert!(heard.len() > kinds.len(), "some come twice");
    let numbers: Vec<u32> = heard.iter().filter_map(|word| word.parse().ok()).collect();
    assert!(!numbers.is_sorted(), "some are overtaken");
    assert_eq!(hundred(7, storm.clone()).await, heard);
    assert_ne!(hundred(8, storm).await, heard);
}

#[tokio::test(start_paused = true)]
async fn a_cut_is_detected_after_its_lease_and_a_brief_cut_is_not() {
    let network = Network::new(1);
    let (_port_a, ear_a, port_b, _) = pair(&network);
    let _token = port_b.announce(&agent("robot"), Incarnation(1)).expect("open");
    tokio::time::sleep(Duration::from_millis(100)).await;
    assert_eq!(ear_a.take_lines(), ["joined robot"]);

    let cut = network.cut([daemon("b")].into(), Duration::from_millis(300));
    port_b.broadcast_state(&agent("robot"), Bytes::from_static(b"beat")).expect("it cannot know");
    tokio::time::sleep(Duration::from_millis(200)).await;
    network.heal(cut);
    tokio::time::sleep(Duration::from_millis(200)).await;
    assert_eq!(ear_a.take_lines(), [""; 0], "a blink loses what was said and is not seen");

    let cut = network.cut([daemon("b")].into(), Duration::from_millis(300));
    tokio::time::sleep(Duration::from_millis(400)).await;
    network.heal(cut);
    tokio::time::sleep(Duration::from_millis(100)).await;
    assert_eq!(ear_a.take_lines(), ["left robot", "joined robot"]);
}

#[tokio::test(start_paused = true)]
async fn an_agent_that_returns_is_present_even_if_messages_are_overtaken() {
    let network = Network::new(1);
    let (_port_a, ear_a, port_b, _) = pair(&network);
    let _token = port_b.announce(&agent("robot"), Incarnation(1)).expect("open");
    network.set_conditions(LinkConditions { overtaken: 0.5, ..LinkConditions::good() });
    for _ in 0..30 {
        let cut = network.cut([daemon("b")].into(), Duration::ZERO);
        tokio::time::sleep(Duration::from_millis(1)).await;
        network.heal(cut);
        tokio::time::sleep(Duration::from_millis(100)).await;
        assert_eq!(ear_a.take_lines().last().map(String::as_str), Some("joined robot"));
    }
}

#[tokio::test(start_paused = true)]
async fn a_kill_is_detected_at_once_and_a_restart_gets_no_old_messages() {
    let network = Network::new(1);
    let (port_a, ear_a, port_b, ear_b) = pair(&network);
    let _token = port_b.announce(&agent("robot"), Incarnation(1)).expect("open");
    tokio::time::sleep(Duration::from_millis(100)).await;
    network.delay_receiver(&daemon("b"), Duration::from_millis(500));
    port_a.broadcast_state(&agent("x"), Bytes::from_static(b"late")).expect("open");
    network.kill(&daemon("b"));
    assert_eq!(port_b.broadcast_state(&agent("robot"), Bytes::new()), Err(SendError::Closed));
    let next = RecordingInbound::new();
    network.open(daemon("b"), Arc::<RecordingInbound>::clone(&next) as _);
    tokio::time::sleep(Duration::from_secs(1)).await;
    assert_eq!(ear_a.take_lines(), ["joined robot", "late", "left robot"]);
    assert_eq!((ear_b.take_lines(), next.take_lines()), (vec!["joined robot".to_owned()], vec![]));
}

#[tokio::test(start_paused = true)]
async fn a_lost_query_lasts_until_its_timeout() {
    let network = Network::new(1);
    let (port, ..) = pair(&network);
    let ask = |daemon: Option<DaemonId>| ResourceQuery {
        daemon,
        resource: Resource::Domain,
        agent: None,
    };
    let (patience, began) = (Duration::from_secs(2), Instant::now());
    assert_eq!(port.ask(ask(None), patience).await.len(), 2);
    assert!(began.elapsed() < Duration::from_millis(50));
    network.cut([daemon("b")].into(), Duration::ZERO);
    assert_eq!(port.ask(ask(Some(daemon("b"))), patience).await.len(), 0);
    assert!(began.elapsed() >= patience);
}

#[tokio::test(start_paused = true)]
async fn a_listener_hears_what_reaches_its_daemon() {
    let network = Network::new(1);
    let (port_a, _, port_b, _) = pair(&network);
    let overheard = Arc::<Mutex<Vec<Bytes>>>::default();
    let notes = Arc::clone(&overheard);
    let hear = move |message: OverheardMessage| {
        notes.lock().expect("no panic").push(message.payload);
    };
    let token = port_b.overhear(Arc::new(hear)).expect("open");
    let beat = async |text: &'static str| {
        let text = Bytes::from_static(text.as_bytes());
        port_a.broadcast_state(&agent("robot"), text).expect("open");
        tokio::time::sleep(Duration::from_millis(100)).await;
    };
    beat("heard").await;
    let cut = network.cut([daemon("b")].into(), Duration::from_secs(1));
    beat("behind the cut").await;
    network.heal(cut);
    beat("heard again").await;
    drop(token);
    beat("after the end").await;
    assert_eq!(*overheard.lock().expect("no panic"), ["heard", "heard again"]);
}
