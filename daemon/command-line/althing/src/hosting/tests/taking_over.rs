//! Tests that there is no single point of failure. Reasoning agents run on two daemons, one of
//! which hosts the leaders. That daemon is killed in the middle of a plan, or all are. Every
//! accepted goal continues, and nothing is done twice.

use std::collections::BTreeMap;
use std::path::PathBuf;

use ::building::BuildingEvent;
use acl::content::{BelievedState, ChangeState};
use agent::Resource;
use substrate::ResourceQuery;

use super::*;

/// The plugins of the reasoning agents.
const REASONING: [&str; 4] =
    ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"];

/// The paper's office, running on several daemons.
struct City {
    building: Building,
    network: Network,
    ecosystem: Ecosystem,
    nodes: BTreeMap<String, DaemonNode>,
    mode: Mode,
    folder: TempDir,
}

impl City {
    /// Opens the office: `alpha` and `beta` host the reasoning agents and a Journal each; `gamma`
    /// hosts a robot that carries a thermometer, and a person's keyboard.
    async fn open(mode: Mode) -> City {
        City::with(&REASONING, mode).await
    }

    /// Opens the office as [`City::open`] does, without Journals.
    async fn without_journals(mode: Mode) -> City {
        City::kept(&REASONING, &[], mode).await
    }

    /// Opens the office with the reasoning agents of `on_both` on `alpha` and `beta`, and all
    /// others on `gamma`.
    async fn with(on_both: &[&str], mode: Mode) -> City {
        City::kept(on_both, &["alpha", "beta"], mode).await
    }

    /// Opens the office as [`City::with`] does, with a Journal on each of the daemons in
    /// `journals`.
    async fn kept(on_both: &[&str], journals: &[&str], mode: Mode) -> City {
        let folder = tempfile::tempdir().expect("a folder");
        let mut text = String::new();
        let on = |daemons: &str, entry: String| {
            entry.trim_end().to_owned() + &format!("\ndaemon = {daemons}\n\n")
        };
        for plugin in REASONING {
            let is_on_both = on_both.contains(&plugin);
            let daemons = if is_on_both { "[\"alpha\", \"beta\"]" } else { "\"gamma\"" };
            text += &on(daemons, entry(plugin, plugin, "{}"));
        }
        for daemon in journals {
            let name = format!("journal-{daemon}");
            text += &on(&format!("\"{daemon}\""), entry(&name, "journal", "{}"));
        }
        let robot = [
            entry("turtlebot-1", "turtlebot", "{ start = \"conf-room\" }"),
            entry("ir-1", "ir-temperature-sensor", "{ mounted-on = \"turtlebot-1\" }"),
        ];
        robot.into_iter().for_each(|entry| text += &on("\"gamma\"", entry));
        let ecosystem = ecosystem(&folder, &text, mode);
        let building = simulate(&ecosystem).unwrap_or_else(|error| panic!("failed to {error}"));
        let (network, nodes) = (Network::new(), BTreeMap::new());
        let mut city = City { building, network, ecosystem, nodes, mode, folder };
        for daemon in ["alpha", "beta", "gamma"] {
            city.start(daemon).await;
        }
        tokio::time::sleep(city.ecosystem.settings.heartbeat_period * 2).await;
        city
    }

    fn state(&self, daemon: &str) -> PathBuf {
        let folder = self.folder.path().join(daemon);
        std::fs::create_dir_all(&folder).expect("made");
        folder
    }

    async fn start(&mut self, name: &str) {
        let daemon = DaemonId::new(name).expect("a name");
        let part = NodeOptions {
            ecosystem: &self.ecosystem,
            agents: self.ecosystem.agents_of(&daemon).cloned().collect(),
            daemon,
            mode: self.mode,
            building: Some(self.building.handle()),
            state: Some(self.state(name)),
        };
        let node = DaemonNode::open(part, MessageTransport::Memory(self.network.clone())).await;
        self.nodes
            .insert(name.to_owned(), node.unwrap_or_else(|error| panic!("failed to {error}")));
    }

    /// Ends a daemon as SIGKILL would end its process.
    async fn kill(&mut self, name: &str) {
        self.network.kill(&DaemonId::new(name).expect("a name"));
        let node = self.nodes.remove(name).expect("it runs");
        let agents: Vec<_> = node.agents().cloned().collect();
        agents.iter().for_each(|agent| node.abort_agent(agent));
        node.drain().await;
    }

    /// Ends a daemon as SIGTERM would end its process.
    async fn stop(&mut self, name: &str) {
        let node = self.nodes.remove(name).expect("it runs");
        assert!(node.drain().await, "all that it did is given up");
    }

    fn person(&self, name: &str) -> Person {
        let (keyboard, terminal) = Keyboard::with_terminal();
        let id = AgentId::new(name).expect("a name");
        self.nodes["gamma"].launch(id, keyboard, self.ecosystem.domain.name.as_str());
        Person { terminal, lines: Vec::new() }
    }

    /// Returns the daemon that hosts the leader of the replicas named `agent`.
    fn acting(&self, agent: &str) -> String {
        let id = AgentId::new(agent).expect("a name");
        let found = self.nodes["gamma"].router().find(&id);
        found.map_or_else(String::new, |resident| resident.daemon.to_string())
    }

    /// Returns the moves that robots made, in the order in which they made them.
    fn moves(&self) -> Vec<String> {
        let truth = self.building.truth();
        let moves = truth.occurrences().filter_map(|occurrence| match &occurrence.event {
            BuildingEvent::Moved { to, .. } => Some(to.to_string()),
            _ => None,
        });
        moves.collect()
    }
}

#[tokio::test(start_paused = true)]
async fn a_goal_is_accepted_when_two_journals_have_it() {
    for mode in MODES {
        let city = City::open(mode).await;
        let mut person = city.person("user");
        person.wish("(known-temperature office2)", Keep::Achieve).await;
        let told = person.hears_of("accepted").await;
        assert_eq!(
            told, "goal 1 accepted; kept by `journal-alpha` and `journal-beta`, 2 of 2",
            "{mode:?}"
        );
        assert!(person.hears().await, "{mode:?}: {:#?}", person.lines);
    }
}

#[tokio::test(start_paused = true)]
async fn a_plan_continues_when_all_leaders_are_killed() {
    for mode in MODES {
        let mut city = City::open(mode).await;
        let mut person = city.person("user");
        assert_eq!(city.acting("plan-requester"), "alpha");
        person.wish("(known-temperature office2)", Keep::Achieve).await;
        person.hears_of("a plan of").await;
        tokio::time::sleep(Duration::from_secs(2)).await;
        assert_eq!(city.moves(), [""; 0], "{mode:?}: it is on its way");

        city.kill("alpha").await;

        assert!(person.hears().await, "{mode:?}: {:#?}", person.lines);
        let told = person.lines.join("\n");
        assert!(told.contains("the goal was taken over; its plan goes on"), "{mode:?}: {told}");
        assert_eq!(city.acting("plan-requester"), "beta", "{mode:?}");
        let moves = city.moves();
        let mut once = moves.clone();
        once.dedup();
        assert_eq!(moves, once, "{mode:?}: no move is made twice");
        assert_eq!(moves.last().map(String::as_str), Some("office2"), "{mode:?}: {told}");
        assert_eq!(told.matches("a plan of").count(), 1, "{mode:?}: {told}");

        // The daemon that comes back is a standby.
        city.start("alpha").await;
        assert!(person.reaches("(known-temperature office1)").await, "{:#?}", person.lines);
        assert_eq!(city.acting("plan-requester"), "beta", "{mode:?}");
        // The new leader goes on with the numbers of the former one.
        let accepted = person.lines.iter().filter(|line| line.contains("goal 2 accepted; kept by"));
        assert_eq!(accepted.count(), 1, "{mode:?}: {:#?}", person.lines);
    }
}

#[tokio::test(start_paused = true)]
async fn an_orderly_stop_of_a_leader_keeps_the_plan() {
    for mode in MODES {
        let mut city = City::open(mode).await;
        let mut person = city.person("user");
        person.wish("(known-temperature office2)", Keep::Achieve).await;
        person.hears_of("a plan of").await;
        tokio::time::sleep(Duration::from_secs(2)).await;
        assert_eq!(city.moves(), [""; 0], "{mode:?}: it is on its way");
        city.stop("alpha").await;
        assert!(person.hears().await, "{mode:?}: {:#?}", person.lines);
        let told = person.lines.join("\n");
        assert_eq!(told.matches("a plan of").count(), 1, "{mode:?}: {told}");
        let (moves, mut once) = (city.moves(), city.moves());
        once.dedup();
        assert_eq!(moves, once, "{mode:?}: no move is made twice");
    }
}

#[tokio::test(start_paused = true)]
async fn each_reasoning_agent_may_be_killed_alone() {
    for mode in MODES {
        for who in REASONING {
            let mut city = City::with(&[who], mode).await;
            let mut person = city.person("user");
            person.wish("(known-temperature office2)", Keep::Achieve).await;
            person.hears_of("a plan of").await;
            tokio::time::sleep(Duration::from_secs(2)).await;
            city.kill("alpha").await;
            assert!(person.hears().await, "{mode:?} {who}: {:#?}", person.lines);
            assert_eq!(city.acting(who), "beta", "{mode:?}");
            let told = person.lines.join("\n");
            assert_eq!(told.matches("a plan of").count(), 1, "{mode:?} {who}: {told}");
            let (moves, mut once) = (city.moves(), city.moves());
            once.dedup();
            assert_eq!(moves, once, "{mode:?} {who}: no move is made twice");
            assert!(person.reaches("(known-temperature office1)").await, "{:#?}", person.lines);
        }
    }
}

#[tokio::test(start_paused = true)]
async fn all_daemons_may_be_killed_at_once_and_restarted() {
    for mode in MODES {
        let mut city = City::open(mode).await;
        let mut person = city.person("user");
        person.wish("(known-temperature office2)", Keep::Maintain).await;
        person.hears_of("a plan of").await;
        tokio::time::sleep(Duration::from_secs(2)).await;
        for daemon in ["alpha", "beta", "gamma"] {
            city.kill(daemon).await;
        }
        let was_read = |truth: &Truth| truth.was_read("office2");
        assert!(!was_read(&city.building.truth()), "{mode:?}");
        for daemon in ["gamma", "beta", "alpha"] {
            city.start(daemon).await;
        }
        let truth = timeout(PATIENCE, city.building.wait_for(was_read)).await;
        truth.unwrap_or_else(|_| panic!("{mode:?}: never read; {:#?}", city.building.truth()));
    }
}

#[tokio::test(start_paused = true)]
async fn a_standby_has_the_requested_changes() {
    let mut city = City::without_journals(Mode::Decentralized).await;
    let mut person = city.person("user");
    let fact = "(connected office1 office2)";
    let change = ChangeState { believe: fact.to_owned(), ..ChangeState::default() };
    person.terminal.requests.send(UserRequest::Set(change)).await.expect("it listens");
    person.hears_of("believed").await;
    assert_eq!(city.acting("domain-maintainer"), "alpha");
    city.kill("alpha").await;
    while city.acting("domain-maintainer") != "beta" {
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    // A new leader queries the others before it acts.
    tokio::time::sleep(Duration::from_secs(1)).await;
    let agent = AgentId::new("domain-maintainer").ok();
    let ask = ResourceQuery { daemon: None, resource: Resource::State, agent };
    let answers = city.nodes["gamma"].router().ask(ask, Duration::from_secs(5)).await;
    let answer = answers.first().expect("it answers");
    let state: BelievedState = serde_json::from_slice(answer).expect("a state");
    assert!(state.facts.iter().any(|known| known.fact == fact), "{state:#?}");
}
