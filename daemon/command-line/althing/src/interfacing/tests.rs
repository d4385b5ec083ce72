//! Tests with the ecosystems `firm` and `house` of `ecosystems/`, each on its own network in
//! memory, in paused time. The results are checked against the true state of the building, and
//! against every byte on both networks.

use std::path::Path;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ::building::{Building, BuildingEvent};
use acl::content::{Achieve, Keep, Outcome, Reason, Refusal, Request, value};
use acl::{AgentId, DaemonId, Performative, Protocol};
use agent::Mode;
use keyboard::{GoalRequest, Keyboard, MessageDraft, Terminal, UserEvent, UserRequest};
use substrate::memory::Network;
use tempfile::TempDir;
use tokio::time::timeout;

use ::interfacing::Interface;

use super::{connect, load};
use crate::config::{Ecosystem, Overrides, Variables};
use crate::hosting::{DaemonNode, MessageTransport, NodeOptions, simulate};
use crate::plugins;

/// Longest time that a test waits for anything. The clock is paused, so that waiting costs no real
/// time.
const PATIENCE: Duration = Duration::from_secs(3_600);

/// Objects, words and people of the firm that must never appear on the house's network.
const SECRETS_OF_FIRM: &[&str] = &[
    "red-room",
    "blue-room",
    "archive",
    "hallway",
    "elevator",
    "entrance",
    "merger",
    "interviews",
    "old-files",
    "used-for",
    "confidential",
    "next-to",
    "stands-in",
    "tidy",
    "walk",
    "cleaner",
    "front-desk",
    "clerk",
    "purpose",
    "paces",
    "caretaker-desk",
];

/// Objects and words of the house that must never appear on the firm's network.
const SECRETS_OF_HOUSE: &[&str] = &[
    "bin-free",
    "bin-emptied-at",
    "empty-bin",
    "boiler-room",
    "staff-only",
    "room-217",
    "room-219",
    "sweeper-1",
    "swept",
    "lobby",
    "corridor-2",
    "tenant",
];

/// A network, and all messages that it has carried.
struct Tapped {
    network: Network,
    said: Arc<Mutex<Vec<String>>>,
}

impl Tapped {
    fn new() -> Tapped {
        let (network, said) = (Network::new(), Arc::new(Mutex::new(Vec::new())));
        let heard = Arc::clone(&said);
        network.tap(move |addressed, payload| {
            let text = format!("{addressed:?} {}", String::from_utf8_lossy(payload));
            heard.lock().expect("nobody panics while it listens").push(text);
        });
        Tapped { network, said }
    }

    fn lines(&self) -> Vec<String> {
        self.said.lock().expect("as above").clone()
    }

    #[track_caller]
    fn never_says(&self, words: &[&str]) {
        let lines = self.lines();
        assert!(lines.len() > 10, "hardly anything was said: {lines:?}");
        for word in words {
            let said = lines.iter().find(|line| line.contains(word));
            assert!(said.is_none(), "`{word}` was said: {said:?}");
        }
    }
}

/// A folder with the files of both ecosystems: those in the repository, with the changes of a test.
struct Files(TempDir);

impl Files {
    fn new(change: impl Fn(&str, String) -> String) -> Files {
        let folder = tempfile::tempdir().expect("a folder");
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..");
        std::fs::create_dir_all(folder.path().join("domains/firm")).expect("made");
        for file in ["domain.pddl", "map.pddl"] {
            let path = format!("domains/firm/{file}");
            let text = std::fs::read_to_string(root.join(&path)).expect("shipped");
            std::fs::write(folder.path().join(&path), text).expect("written");
        }
        for name in ["house", "firm"] {
            let path = format!("ecosystems/{name}.toml");
            let text = std::fs::read_to_string(root.join(&path)).expect("shipped");
            std::fs::create_dir_all(folder.path().join("ecosystems")).expect("made");
            std::fs::write(folder.path().join(path), change(name, text)).expect("written");
        }
        Files(folder)
    }

    #[track_caller]
    fn load(&self, name: &str, mode: Mode) -> Ecosystem {
        let file = self.0.path().join(format!("ecosystems/{name}.toml"));
        let overrides = Overrides::default().mode(Some(mode));
        let loaded = Ecosystem::load_with(&file, &Variables::new(), &overrides, &plugins::known());
        loaded.unwrap_or_else(|error| panic!("{error:?}"))
    }
}

/// The firm and the house, both running, with the interfaces between them.
struct Street {
    building: Building,
    house: DaemonNode,
    firm: DaemonNode,
    house_wire: Tapped,
    firm_wire: Tapped,
    /// The nodes by which the interfaces join the other ecosystem.
    abroad: Vec<DaemonNode>,
    interfaces: Vec<Interface>,
    firm_ecosystem: Ecosystem,
    _files: Files,
}

async fn open(
    ecosystem: &Ecosystem,
    name: &str,
    transport: &Tapped,
    building: Option<&Building>,
) -> DaemonNode {
    let part = NodeOptions {
        ecosystem,
        daemon: DaemonId::new(name).expect("a name"),
        agents: if building.is_some() || name == "front-desk" {
            ecosystem.agents.clone()
        } else {
            Vec::new()
        },
        mode: ecosystem.mode,
        building: building.map(Building::handle),
        state: None,
    };
    let node = DaemonNode::open(part, MessageTransport::Memory(transport.network.clone())).await;
    node.unwrap_or_else(|error| panic!("failed to {error}"))
}

impl Street {
    async fn open(mode: Mode, change: impl Fn(&str, String) -> String) -> Street {
        let files = Files::new(change);
        let (house_ecosystem, firm_ecosystem) =
            (files.load("house", mode), files.load("firm", mode));
        let building = simulate(&house_ecosystem).unwrap_or_else(|error| panic!("{error}"));
        let (house_wire, firm_wire) = (Tapped::new(), Tapped::new());
        let house = open(&house_ecosystem, "caretaker", &house_wire, Some(&building)).await;
        let firm = open(&firm_ecosystem, "front-desk", &firm_wire, None).await;
        let (mut abroad, mut interfaces) = (Vec::new(), Vec::new());
        let sides = [
            (&firm_ecosystem, &firm, &house_ecosystem, &house_wire),
            (&house_ecosystem, &house, &firm_ecosystem, &firm_wire),
        ];
        for (ours, home, theirs, transport) in sides {
            for (index, entry) in ours.interfaces.iter().enumerate() {
                if let Err(report) = load(ours, index, &plugins::known()) {
                    panic!("{report:?}");
                }
                let away = open(theirs, entry.remote_name.as_str(), transport, None).await;
                let (here, there) =
                    (home.spawner().expect("a place"), away.spawner().expect("one"));
                let connected = connect(
                    entry,
                    &ours.ecosystem_endpoint(here),
                    &theirs.ecosystem_endpoint(there),
                );
                interfaces.push(connected.unwrap_or_else(|error| panic!("{error}")));
                abroad.push(away);
            }
        }
        // Waits for heartbeats, so that all agents know each other.
        tokio::time::sleep(firm_ecosystem.settings.heartbeat_period * 3).await;
        Street {
            building,
            house,
            firm,
            house_wire,
            firm_wire,
            abroad,
            interfaces,
            firm_ecosystem,
            _files: files,
        }
    }

    fn clerk(&self) -> Terminal {
        let (keyboard, terminal) = Keyboard::with_terminal();
        let ontology = self.firm_ecosystem.domain.name.as_str();
        self.firm.launch(AgentId::new("clerk").expect("a name"), keyboard, ontology);
        terminal
    }

    fn is_in_firm(&self, agent: &str) -> bool {
        self.firm.router().find(&AgentId::new(agent).expect("a name")).is_some()
    }

    async fn until_in_firm(&self, agent: &str, is_there: bool) {
        let (_, mut changes) = self.firm.router().presence_changes();
        let changed = async {
            while self.is_in_firm(agent) != is_there {
                changes.recv().await.expect("few changes");
            }
        };
        let in_time = timeout(PATIENCE, changed).await;
        assert!(in_time.is_ok(), "`{agent}`: {is_there} is never so");
    }

    async fn close(self) {
        self.firm.drain().await;
        for node in self.abroad {
            node.drain().await;
        }
        self.house.drain().await;
    }
}

fn as_shipped(_: &str, text: String) -> String {
    text
}

async fn say(terminal: &Terminal, said: UserRequest) {
    terminal.requests.send(said).await.expect("the keyboard listens");
}

async fn wish(terminal: &Terminal, ecosystem: &Ecosystem, goal: &str) {
    let goal = ecosystem.find_goal(goal).expect("a goal").goal;
    say(
        terminal,
        UserRequest::RequestGoal(GoalRequest {
            goal,
            keep: Keep::Achieve,
            priority: 0,
            partition: Default::default(),
        }),
    )
    .await;
}

/// Waits until a request has ended. Returns whether the request succeeded, and the texts of all
/// reports.
async fn hear_end(terminal: &mut Terminal) -> (bool, Vec<String>) {
    let mut lines = Vec::new();
    loop {
        let heard =
            timeout(PATIENCE, terminal.events.recv()).await.expect("in time").expect("lives");
        match &heard {
            UserEvent::Report(_, report) => lines.push(report.detail.clone()),
            UserEvent::Refused(_, refusal) => lines.push(refusal.detail.clone()),
            _ => (),
        }
        if heard.is_final() {
            return (heard.is_success(), lines);
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_borrowed_robot_acts_and_no_secret_crosses() {
    for mode in [Mode::Decentralized, Mode::Centralized] {
        let street = Street::open(mode, as_shipped).await;
        let mut clerk = street.clerk();
        wish(&clerk, &street.firm_ecosystem, "merger").await;
        let (reached, lines) = hear_end(&mut clerk).await;
        assert!(reached, "{mode:?}: {lines:#?}");
        let truth = street.building.truth();
        assert_eq!(truth.swept_count("room-217"), 1, "{mode:?}");
        assert_eq!(truth.swept_count("room-218"), 0, "nobody asked for it");
        assert!(lines.iter().all(|line| !line.contains("217")), "{lines:?}");

        wish(&clerk, &street.firm_ecosystem, "archive").await;
        let (reached, lines) = hear_end(&mut clerk).await;
        assert!(!reached, "the house has no name for it: {lines:?}");

        street.house_wire.never_says(SECRETS_OF_FIRM);
        street.firm_wire.never_says(SECRETS_OF_HOUSE);
        street.close().await;
    }
}

/// An action that passes the interface is carried out exactly once in the other ecosystem. The two
/// ecosystems share no identifiers of messages or conversations.
#[tokio::test(start_paused = true)]
async fn ids_and_conversations_do_not_cross_an_interface() {
    let street = Street::open(Mode::Decentralized, as_shipped).await;
    let mut clerk = street.clerk();
    wish(&clerk, &street.firm_ecosystem, "merger").await;
    assert!(hear_end(&mut clerk).await.0);
    let ids = |lines: Vec<String>| -> std::collections::BTreeSet<String> {
        let message = |line: &String| line.find('{').map(|at| line[at..].to_owned());
        let read = |text: String| serde_json::from_str::<serde_json::Value>(&text).ok();
        let of = |message: serde_json::Value| {
            ["id", "conversation_id", "reply_with"]
                .map(|field| message[field].as_str().map(str::to_owned))
        };
        // Conversations of heartbeats are named after their sender; they are excluded, because
        // their names have no dot.
        let lines = lines.iter().filter_map(message).filter_map(read).flat_map(of).flatten();
        lines.filter(|id| id.contains('.')).collect()
    };
    let (of_house, of_firm) = (ids(street.house_wire.lines()), ids(street.firm_wire.lines()));
    assert!(of_house.len() > 10 && of_firm.len() > 10);
    let shared: Vec<_> = of_house.intersection(&of_firm).collect();
    // Both ecosystems have reasoning agents of the same names, with incarnations of their own.
    assert_eq!(shared, Vec::<&String>::new());
    street.close().await;
}

#[tokio::test(start_paused = true)]
async fn a_proxy_leaves_when_the_real_agent_dies() {
    for mode in [Mode::Decentralized, Mode::Centralized] {
        let street = Street::open(mode, as_shipped).await;
        assert!(street.is_in_firm("cleaner"));
        let mut clerk = street.clerk();
        wish(&clerk, &street.firm_ecosystem, "merger").await;
        let departed = |event: &BuildingEvent| matches!(event, BuildingEvent::Departed { .. });
        timeout(PATIENCE, street.building.wait_for(|truth| truth.any(departed)))
            .await
            .expect("off");
        let began = tokio::time::Instant::now();
        street.house.abort_agent(&AgentId::new("sweeper-1").expect("a name"));
        street.until_in_firm("cleaner", false).await;
        assert!(began.elapsed() < Duration::from_millis(100), "{:?}", began.elapsed());
        let (reached, lines) = hear_end(&mut clerk).await;
        assert!(!reached, "{mode:?}: {lines:?}");
        let last = lines.last().expect("a reason");
        assert!(last.contains("tidy") || last.contains("clean"), "{mode:?}: {lines:?}");
        assert_eq!(street.building.truth().swept_count("room-217"), 0);
        street.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_cancellation_crosses_the_interface() {
    let street = Street::open(Mode::Decentralized, as_shipped).await;
    let mut clerk = street.clerk();
    wish(&clerk, &street.firm_ecosystem, "merger").await;
    let asked = timeout(PATIENCE, clerk.events.recv()).await.expect("in time").expect("lives");
    let UserEvent::Sent(about) = asked else { panic!("{asked:?}") };
    let departed = |event: &BuildingEvent| matches!(event, BuildingEvent::Departed { .. });
    timeout(PATIENCE, street.building.wait_for(|truth| truth.any(departed))).await.expect("off");
    say(&clerk, UserRequest::Cancel(about.conversation)).await;
    let stayed = |event: &BuildingEvent| matches!(event, BuildingEvent::Stayed { .. });
    let stopped = street.building.wait_for(|truth| truth.any(stayed));
    timeout(PATIENCE, stopped).await.expect("the robot is called off in the house");
    assert_eq!(street.building.truth().swept_count("room-217"), 0);
    street.close().await;
}

/// The house imports its own robot, which it lends to the firm. Without a check, messages about the
/// robot would pass back and forth for ever.
#[tokio::test(start_paused = true)]
async fn a_loop_of_interfaces_is_stopped() {
    let street = Street::open(Mode::Decentralized, |name, text| match name {
        "house" => {
            text + "[[interface]]\necosystem = \"firm.toml\"\ndaemon = \"caretaker\"\nas = \"landlord\"\n\
                types = { location = \"spot\", mobile-base = \"helper\" }\n\
                predicates = { connected = \"next-to\", at = \"stands-in\", swept = \"clean\", \
                shared = \"shared-with-house\" }\n\
                functions = { distance = \"paces\" }\n\
                objects = { room-217 = \"red-room\" }\n\
                [[interface.import]]\nagent = \"cleaner\"\nas = \"ghost\"\n\
                actions = { move = \"walk\", sweep = \"tidy\" }\n"
        }
        _ => text,
    })
    .await;
    tokio::time::sleep(Duration::from_secs(60)).await;
    let looped = |interface: &Interface| {
        let imported = &interface.imported;
        [&imported.looped_agents, &imported.looped_goals].map(|count| count.load(Relaxed))
    };
    assert_eq!(street.interfaces.iter().map(looped).collect::<Vec<_>>(), [[0, 0], [1, 0]]);
    let ghost = AgentId::new("ghost").expect("a name");
    assert!(street.house.router().find(&ghost).is_none());
    assert!(street.is_in_firm("cleaner"));
    let mut clerk = street.clerk();
    wish(&clerk, &street.firm_ecosystem, "merger").await;
    assert!(hear_end(&mut clerk).await.0, "the rest of it works");
    street.close().await;
}

fn goal_for_desk(goal: &str) -> UserRequest {
    let achieve = Achieve::new(goal, Keep::Achieve, 0);
    UserRequest::Send(MessageDraft {
        to: AgentId::new("caretaker-desk").ok(),
        performative: Performative::Request,
        protocol: Protocol::Goal,
        conversation: None,
        content: value(&Request::Achieve(achieve)),
        patience: PATIENCE,
    })
}

/// Waits for the final answer of a goal gateway to a goal, and returns it.
async fn desk_answers(clerk: &mut Terminal) -> Result<Outcome, Refusal> {
    loop {
        let heard = timeout(PATIENCE, clerk.events.recv()).await.expect("in time").expect("lives");
        let UserEvent::Answered(_, message) = &heard else { continue };
        if !heard.is_final() {
            continue;
        }
        return match message.performative {
            Performative::Confirm => {
                let report: acl::content::Report = message.content_as().expect("a report");
                Ok(report.outcome)
            }
            _ => Err(message.content_as().expect("a refusal")),
        };
    }
}

#[tokio::test(start_paused = true)]
async fn goals_pass_that_a_rule_names_and_no_others() {
    let street = Street::open(Mode::Decentralized, as_shipped).await;
    let mut clerk = street.clerk();
    say(&clerk, goal_for_desk("(and (clean blue-room) (clean red-room))")).await;
    assert_eq!(desk_answers(&mut clerk).await, Ok(Outcome::Done));
    let truth = street.building.truth();
    assert_eq!((truth.swept_count("room-217"), truth.swept_count("room-218")), (1, 1));
    for (goal, word) in [
        ("(clean archive)", "not exported"),
        ("(confidential red-room)", "do not pass"),
        ("(forall (?o - office) (clean ?o))", "only facts"),
        ("(clean ?x)", "names its objects"),
        ("(clean", "1:"),
    ] {
        say(&clerk, goal_for_desk(goal)).await;
        let refusal = desk_answers(&mut clerk).await.expect_err(goal);
        assert!(refusal.detail.contains(word), "{goal}: {refusal:?}");
    }
    street.house_wire.never_says(SECRETS_OF_FIRM);
    street.close().await;
}

#[tokio::test(start_paused = true)]
async fn a_flood_is_refused_with_the_reason() {
    let street = Street::open(Mode::Decentralized, |name, text| match name {
        "firm" => text.replace("rate = 20 ", "rate = 2 "),
        _ => text,
    })
    .await;
    let mut clerk = street.clerk();
    let before = street.house_wire.lines().len();
    for _ in 0..60 {
        say(&clerk, goal_for_desk("(clean red-room)")).await;
    }
    let mut refused = 0;
    for _ in 0..60 {
        if let Err(refusal) = desk_answers(&mut clerk).await {
            assert_eq!(refusal.reason, Reason::Busy, "{refusal:?}");
            refused += 1;
        }
    }
    assert_eq!(refused, 56, "four are two seconds' worth");
    let lines = street.house_wire.lines();
    let is_asked =
        |line: &&String| line.contains("\"sender\":\"tenant\"") && line.contains("achieve");
    let asked = lines[before..].iter().filter(is_asked).count();
    assert!((1..=4).contains(&asked), "{asked}");
    let over = street.interfaces[0].imported.over_rate.load(std::sync::atomic::Ordering::Relaxed);
    assert_eq!(over, 56);
    street.close().await;
}

/// The lender's file can define the same loan as the borrower's file: as an export instead of an
/// import.
#[tokio::test(start_paused = true)]
async fn a_robot_may_be_exported_instead_of_imported() {
    let street = Street::open(Mode::Centralized, |name, text| match name {
        "firm" => {
            let (before, rest) = text.split_once("[[interface]]").expect("it has one");
            let (_, goals) = rest.split_once("[goals]").expect("it has goals");
            format!("{before}[goals]{goals}")
        }
        _ => {
            text + "[[interface]]\necosystem = \"firm.toml\"\ndaemon = \"caretaker\"\nas = \"landlord\"\n\
                types = { location = \"spot\", mobile-base = \"helper\" }\n\
                predicates = { connected = \"next-to\", at = \"stands-in\", swept = \"clean\" }\n\
                functions = { distance = \"paces\" }\n\
                objects = { room-217 = \"red-room\", corridor-2 = \"hallway\", lift = \"elevator\", \
                lobby = \"entrance\" }\n\
                [[interface.export]]\nagent = \"sweeper-1\"\nas = \"cleaner\"\n\
                actions = { move = \"walk\", sweep = \"tidy\" }\n"
        }
    })
    .await;
    let mut clerk = street.clerk();
    wish(&clerk, &street.firm_ecosystem, "merger").await;
    let (reached, lines) = hear_end(&mut clerk).await;
    assert!(reached, "{lines:#?}");
    assert_eq!(street.building.truth().swept_count("room-217"), 1);
    street.house_wire.never_says(&SECRETS_OF_FIRM[..16]);
    street.firm_wire.never_says(&SECRETS_OF_HOUSE[..10]);
    street.close().await;
}
