//! A testbed for faults: an ecosystem of six machines, each a network namespace with a real daemon,
//! in a simulated building with a truth that only the test knows.
//!
//! - `alpha` and `beta` take goals and plan, one as leader; `gamma` and `delta` execute plans, one
//!   as leader; `robot` is a robot. `desk` hosts no agent: people request goals there, and no fault
//!   hits it. `alpha`, `beta` and `gamma` have Journals.
//! - Waiting is always for an event: presence, a report to a goal's command, or the truth.
//! - The testbed requests goals and judges; the faults are in `faults.rs`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::sync::{Arc, Condvar, Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};

use acl::content::{ActionToken, BelievedState, Record};
use acl::{AgentId, DaemonId, EcosystemId};
use building::{Building, BuildingEvent, Layout, Server};
use credentials::{CredentialFolder, DaemonIdentity, Trust, Verifier};
use serde_json::Value;
use substrate::{
    Delivery, Inbound, Presence, ReceivedQuery, Resident, Resource, ResourceQuery, Substrate as _,
};
use substrate_zenoh::{Config, Security, SessionMode, ZenohSubstrate};
use tokio::runtime::Runtime;

use crate::support::network::{Site, secured};
use crate::support::{Office, lines};

/// Time limit of every step: ten leases.
const PATIENCE: Duration = Duration::from_secs(40);

pub(crate) const ROBOT: &str = "turtlebot-1";
pub(crate) const MACHINES: [&str; 6] = ["alpha", "beta", "gamma", "delta", "robot", "desk"];

/// A network without machines, and one for the other side of a partition.
pub(crate) const NOWHERE: &str = "nowhere";
pub(crate) const ISLAND: &str = "island";

/// The robot drives 6 meters in half a second: long enough for a fault to strike on the way.
const TIME_SCALE: f64 = 0.025;

/// Rate limit for answers from one machine to the listening client, per second: more than there
/// are.
const EAR_PER_SECOND: u32 = 100_000;

/// Machines with a small disk of their own, and its size: room for two journals.
const SMALL_DISKS: [&str; 2] = ["alpha", "robot"];
const DISK_BYTES: &str = "8m";

pub(crate) struct Testbed {
    pub(crate) site: Site,
    pub(crate) present: Arc<Present>,
    building: Building,
    runtime: Runtime,
    /// Client at the desk that receives presence and answers.
    ear: Arc<ZenohSubstrate>,
    /// Conversations of the goals that were accepted.
    accepted: BTreeSet<String>,
    _server: Server,
}

/// A requested goal, and the reports about it so far.
pub(crate) struct Asked {
    child: Child,
    lines: mpsc::Receiver<String>,
    pub(crate) said: Vec<String>,
    pub(crate) place: String,
}

/// The outcome of a goal.
pub(crate) struct Ending {
    pub(crate) is_achieved: bool,
    pub(crate) said: Vec<String>,
}

/// Present agents, as the desk's router reports them.
#[derive(Default)]
pub(crate) struct Present {
    residents: Mutex<BTreeSet<Resident>>,
    changed: Condvar,
}

impl Inbound for Present {
    fn deliver(&self, _: Delivery) {}
    fn receive_query(&self, _: ReceivedQuery) {}
    fn presence(&self, presence: Presence) {
        let mut residents = self.residents.lock().unwrap_or_else(PoisonError::into_inner);
        match presence {
            Presence::Joined(resident) => residents.insert(resident),
            Presence::Left(resident) => residents.remove(&resident),
        };
        self.changed.notify_all();
    }
}

// === impl Present ===

impl Present {
    /// Waits until the present agents satisfy `is_right`.
    pub(crate) fn until(
        &self,
        what: &str,
        is_right: impl Fn(&BTreeSet<Resident>) -> bool,
    ) -> Result<(), String> {
        let residents = self.residents.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.changed.wait_timeout_while(residents, PATIENCE, |now| !is_right(now));
        let (residents, timeout) = waited.unwrap_or_else(PoisonError::into_inner);
        if timeout.timed_out() { Err(format!("not {what}: {residents:?}")) } else { Ok(()) }
    }

    /// Waits until no agent of these daemons is present.
    pub(crate) fn gone(&self, daemons: &[&str]) -> Result<(), String> {
        let is_of = |each: &Resident| daemons.contains(&each.daemon.as_str());
        self.until(&format!("{daemons:?} gone"), |now| !now.iter().any(is_of))
    }

    /// Returns the daemon with the leader of this name: the agent with the smallest incarnation.
    pub(crate) fn acting(&self, agent: &str) -> String {
        let residents = self.residents.lock().unwrap_or_else(PoisonError::into_inner);
        let named = residents.iter().filter(|each| each.agent.as_str() == agent);
        let first = named.min_by_key(|each| each.incarnation);
        first.map_or_else(String::new, |each| each.daemon.to_string())
    }
}

// === impl Testbed ===

impl Testbed {
    /// Opens the testbed. Returns `None` if namespaces are not permitted.
    pub(crate) fn open(mode: &str) -> Option<Testbed> {
        let office = secured(&ecosystem(mode), &MACHINES);
        let mut site = Site::on_lan(office, &MACHINES)?;
        site.network(NOWHERE);
        site.network(ISLAND);
        for machine in SMALL_DISKS {
            let folder = site.office.folder().join("state/lab").join(machine);
            site.small_disk(machine, &folder, DISK_BYTES);
        }
        let runtime = Runtime::new().expect("threads");
        let (building, server) = runtime.block_on(async {
            let building = Building::new(layout(), TIME_SCALE).expect("a sound scale");
            let socket = site.office.folder().join("building.sock");
            let server = building::serve(building.handle(), &socket).await.expect("a free socket");
            (building, server)
        });
        MACHINES.iter().for_each(|machine| up(&mut site, machine));
        let present = Arc::<Present>::default();
        let ear = runtime.block_on(ear(&site, &present));
        let accepted = BTreeSet::new();
        Some(Testbed { site, present, building, runtime, ear, accepted, _server: server })
    }

    pub(crate) fn up(&mut self, machine: &str) {
        up(&mut self.site, machine);
    }

    /// Waits until all agents are present.
    pub(crate) fn whole(&self) -> Result<(), String> {
        let mut expected = BTreeSet::new();
        for (agent, _, daemons) in agents() {
            expected.extend(daemons.iter().map(|daemon| (agent, *daemon)));
        }
        let here = |now: &BTreeSet<Resident>| {
            let now: BTreeSet<_> =
                now.iter().map(|each| (each.agent.as_str(), each.daemon.as_str())).collect();
            expected.is_subset(&now)
        };
        self.present.until("whole", here)?;
        self.until_known()
    }

    /// Waits until the ecosystem knows the place of the robot. A daemon that was cut off believes
    /// the former place until the robot's next heartbeat.
    fn until_known(&self) -> Result<(), String> {
        let maintainer = AgentId::new("domain-maintainer").ok();
        let deadline = Instant::now() + PATIENCE;
        loop {
            let here = self.building.place_of(ROBOT).expect("it is somewhere");
            let ask = ResourceQuery {
                daemon: None,
                resource: Resource::State,
                agent: maintainer.clone(),
            };
            let answers = self.runtime.block_on(self.ear.ask(ask, Duration::from_secs(2)));
            let read = |answer| serde_json::from_slice::<BelievedState>(answer).ok();
            let states: Vec<_> = answers.iter().filter_map(|answer| read(answer)).collect();
            let fact = format!("(at {ROBOT} {here})");
            let knows = |state: &BelievedState| state.facts.iter().any(|each| each.fact == fact);
            if !states.is_empty() && states.iter().all(knows) {
                return Ok(());
            }
            if Instant::now() > deadline {
                return Err(format!("nobody knows `{fact}`: {states:?}"));
            }
        }
    }

    /// Requests that the robot be at another place.
    pub(crate) fn ask(&self, number: usize, options: &[&str]) -> Asked {
        let here = self.building.place_of(ROBOT).expect("it is somewhere");
        let places = ["office1", "conf-room", "office2", "corridor"];
        let mut others = places.into_iter().cycle().skip(number).filter(|place| *place != here);
        let place = others.next().expect("there are more").to_owned();
        let mut command = self.site.program("desk", env!("CARGO_BIN_EXE_althing"));
        command.args(["goal", &format!("(at {ROBOT} {place})")]).args(options);
        command.arg("--ecosystem").arg(&self.site.office.file);
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the binary is built");
        let lines = lines(&mut child);
        Asked { child, lines, said: Vec::new(), place }
    }

    /// Requests that the robot be at another place, and waits until it has set off.
    pub(crate) fn under_way(&self, number: usize) -> Result<Asked, String> {
        let mark = self.mark();
        let mut asked = self.ask(number, &[]);
        self.until_departed(mark, &mut asked)?;
        Ok(asked)
    }

    /// Follows a goal to its end; a reported success must be true in the building.
    pub(crate) fn ended(&mut self, mut asked: Asked) -> Result<Ending, String> {
        while !asked.has_ended() {
            asked.next()?;
        }
        let end = asked.said.last().cloned().unwrap_or_default();
        let is_achieved = end.starts_with("done");
        let conversation = asked.said.iter().find_map(|line| line.strip_prefix("asked"));
        let is_accepted = asked.said.iter().any(|line| line.contains("accepted; kept by"));
        if let Some(conversation) = conversation.filter(|_| is_accepted) {
            self.accepted.insert(conversation.trim().to_owned());
        }
        let is_there = self.building.place_of(ROBOT).is_ok_and(|place| place == asked.place);
        if is_achieved && !is_there {
            return Err(format!("the robot is not in {}: {:#?}", asked.place, asked.said));
        }
        if end.split_whitespace().count() < 2 {
            return Err(format!("an end without a reason: {:#?}", asked.said));
        }
        Ok(Ending { is_achieved, said: std::mem::take(&mut asked.said) })
    }

    /// Returns the view of each machine, to diagnose a failure.
    pub(crate) fn dump(&mut self) -> String {
        let ended = self.site.office.ended().join("\n");
        let views = MACHINES.map(|machine| {
            let (_, agents) = self.site.ask(machine, &["agents"]);
            format!("from {machine}:\n{agents}")
        });
        let (_, goals) = self.site.ask("desk", &["goals"]);
        format!("{ended}\n{}goals:\n{goals}", views.concat())
    }

    /// Waits until the machines that were cut off and the rest no longer see each other, each from
    /// its own view: lost links are detected at different times.
    pub(crate) fn cut_off(&self, hosts: &[&str]) -> Result<(), String> {
        self.present.gone(hosts)?;
        let deadline = Instant::now() + PATIENCE;
        for machine in MACHINES {
            let is_away = hosts.contains(&machine);
            let is_beyond = |seen: &String| hosts.contains(&seen.as_str()) != is_away;
            while self.site.hosts_seen(machine).iter().any(is_beyond) {
                if Instant::now() > deadline {
                    let seen = self.site.hosts_seen(machine);
                    return Err(format!("`{machine}` still sees {seen:?}"));
                }
            }
        }
        Ok(())
    }

    // === the truth ===

    /// Returns the present position in the building's log.
    pub(crate) fn mark(&self) -> u64 {
        self.building.truth().next_sequence()
    }

    /// Returns how often the robot has set off since a position of the log.
    pub(crate) fn departures(&self, since: u64) -> usize {
        let truth = self.building.truth();
        let since = truth.occurrences().filter(|each| each.sequence >= since);
        since.filter(|each| matches!(each.event, BuildingEvent::Departed { .. })).count()
    }

    /// Waits until the robot has set off since a position of the log; fails if the goal ends
    /// before.
    fn until_departed(&self, since: u64, asked: &mut Asked) -> Result<(), String> {
        let deadline = Instant::now() + PATIENCE;
        while self.departures(since) == 0 {
            // Reports may come before or after the robot sets off, so the truth is checked after
            // each wait.
            let line = asked.lines.recv_timeout(Duration::from_millis(20));
            asked.said.extend(line);
            if asked.has_ended() || Instant::now() > deadline {
                return Err(format!("never set off to {}: {:#?}", asked.place, asked.said));
            }
        }
        Ok(())
    }

    /// Returns how many commands the robot has ever begun, according to its ledger.
    pub(crate) fn commands(&self) -> usize {
        let ledger = self.kept("robot", &format!("{ROBOT}.tokens"));
        let ledger = std::fs::read_to_string(ledger).unwrap_or_default();
        let begun = |line: &str| {
            let line: Value = serde_json::from_str(line).ok()?;
            let token = line.get("begun").or_else(|| line.get("ended")?.get("token"))?;
            Some(token.to_string())
        };
        ledger.lines().filter_map(begun).collect::<BTreeSet<_>>().len()
    }

    /// Checks in the robot's ledger that no command was begun twice, and none of an older plan for
    /// a goal after one of a newer plan.
    pub(crate) fn check_ledger(&self) -> Result<(), String> {
        let ledger = self.kept("robot", &format!("{ROBOT}.tokens"));
        let ledger = std::fs::read_to_string(ledger).unwrap_or_default();
        let token = |value: &Value| serde_json::from_value::<ActionToken>(value.clone()).ok();
        let (mut seen, mut newest) = (BTreeSet::new(), BTreeMap::new());
        for line in ledger.lines() {
            let Ok(line) = serde_json::from_str::<Value>(line) else { continue };
            // The ledger keeps only the end of a command that an earlier incarnation began and
            // ended.
            if let Some(ended) = line.get("ended").and_then(|end| token(&end["token"])) {
                let plan = (ended.term, ended.round);
                let newest = newest.entry(ended.conversation.clone()).or_insert(plan);
                *newest = plan.max(*newest);
                seen.insert(ended);
            }
            let Some(begun) = line.get("begun").and_then(token) else { continue };
            let plan = (begun.term, begun.round);
            let newest = newest.entry(begun.conversation.clone()).or_insert(plan);
            if plan < *newest {
                return Err(format!("{begun} is begun after a command of the plan {newest:?}"));
            }
            *newest = plan;
            if !seen.insert(begun.clone()) {
                return Err(format!("{begun} is begun twice"));
            }
        }
        Ok(())
    }

    /// Returns the path of a file in the state folder of a daemon.
    pub(crate) fn kept(&self, daemon: &str, file: &str) -> PathBuf {
        let folder = self.site.office.folder().join("state/lab").join(daemon);
        self.site.path(daemon, &folder).join(file)
    }

    // === the journals ===

    /// Kills and restarts all machines, and checks that every Journal has every accepted goal and
    /// its end. Returns the number of goals.
    pub(crate) fn check_journals(&mut self) -> Result<usize, String> {
        let hosts = &MACHINES[..5];
        hosts.iter().for_each(|host| self.site.office.kill(host));
        self.present.gone(hosts)?;
        hosts.iter().for_each(|host| up(&mut self.site, host));
        self.whole()?;
        self.until_kept(&self.accepted)?;
        Ok(self.accepted.len())
    }

    /// Waits until every Journal has these goals and their ends.
    fn until_kept(&self, goals: &BTreeSet<String>) -> Result<(), String> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let journals = self.journals();
            let missing = goals.iter().find(|conversation| {
                let key = format!("goal/{conversation}");
                let has_ended = |journal: &Vec<Record>| {
                    let record = journal.iter().find(|record| record.key == key);
                    record.is_some_and(|record| record.body["ended"].is_object())
                };
                !journals.iter().all(has_ended)
            });
            match missing {
                None if journals.len() == 3 => return Ok(()),
                _ if Instant::now() < deadline => (),
                None => return Err(format!("only {} journals answer", journals.len())),
                Some(conversation) => return Err(format!("{conversation} is lost, or open")),
            }
        }
    }

    /// Waits until every Journal has the goal with this outcome.
    pub(crate) fn until_kept_by_all(&self, ending: &Ending) -> Result<(), String> {
        let asked = ending.said.iter().find_map(|line| line.strip_prefix("asked"));
        let conversation = asked.ok_or("it was not asked for")?.trim().to_owned();
        self.until_kept(&BTreeSet::from([conversation]))
    }

    fn journals(&self) -> Vec<Vec<Record>> {
        let ask = ResourceQuery { daemon: None, resource: Resource::Journal, agent: None };
        let asked = self.ear.ask(ask, Duration::from_secs(2));
        let answers = self.runtime.block_on(asked);
        answers.iter().filter_map(|answer| serde_json::from_slice(answer).ok()).collect()
    }
}

// === impl Asked ===

impl Asked {
    /// Waits until a report contains these words.
    pub(crate) fn until(&mut self, words: &str) -> Result<(), String> {
        while !self.said.iter().any(|line| line.contains(words)) {
            self.next().map_err(|problem| format!("never said `{words}`: {problem}"))?;
        }
        Ok(())
    }

    fn has_ended(&self) -> bool {
        let ends = ["done", "failed", "refused", "no reply", "cancelled"];
        self.said.last().is_some_and(|last| ends.iter().any(|end| last.starts_with(end)))
    }

    fn next(&mut self) -> Result<(), String> {
        match self.lines.recv_timeout(PATIENCE) {
            Ok(line) => self.said.push(line),
            Err(_) => return Err(format!("nothing more is said: {:#?}", self.said)),
        }
        Ok(())
    }
}

impl Drop for Asked {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

// === the ecosystem ===

/// Starts a daemon that connects to all machines before it, so that a restarted one is linked at
/// once.
fn up(site: &mut Site, machine: &str) {
    let before = (1..).zip(MACHINES).take_while(|(_, each)| *each != machine);
    let endpoints: Vec<_> = before.map(|(n, _)| format!("tls/10.0.0.{n}:7447")).collect();
    let options: Vec<_> = endpoints.iter().flat_map(|each| ["--connect", each]).collect();
    site.up(machine, &options);
}

async fn ear(site: &Site, present: &Arc<Present>) -> Arc<ZenohSubstrate> {
    let socket = site.office.runtime_folder().join("lab/desk.sock");
    let socket = site.path("desk", &socket);
    let ecosystem = EcosystemId::new("lab").expect("a name");
    // The client connects through the desk, as a command does, and uses the desk's key.
    let keys = CredentialFolder::new(site.office.folder().join("keys"));
    let desk = DaemonId::new("desk").expect("a name");
    let guest = desk.guest("ear").expect("short");
    let trust = Trust::read(&keys).expect("made for the site");
    let identity = DaemonIdentity::read(&keys, &desk, &trust).expect("made for the site");
    let identity = Arc::new(identity.for_guest(guest.clone()));
    let verifier = Arc::new(Verifier::new(trust, EAR_PER_SECOND));
    let mut config = Config::new(ecosystem, guest);
    config.security = Some(Security { identity, verifier });
    config.mode = SessionMode::Client;
    config.connect = vec![format!("unixsock-stream/{}", socket.display())];
    config.open(Arc::<Present>::clone(present)).await.expect("the desk's daemon runs")
}

/// Name, plugin and daemons of every agent.
fn agents() -> [(&'static str, &'static str, &'static [&'static str]); 8] {
    let planning: &[&str] = &["alpha", "beta"];
    [
        ("domain-maintainer", "domain-maintainer", planning),
        ("plan-requester", "plan-requester", planning),
        ("planning-agent", "planning-agent", planning),
        ("plan-executor", "plan-executor", &["gamma", "delta"]),
        ("journal-alpha", "journal", &["alpha"]),
        ("journal-beta", "journal", &["beta"]),
        ("journal-gamma", "journal", &["gamma"]),
        (ROBOT, "turtlebot", &["robot"]),
    ]
}

fn ecosystem(mode: &str) -> String {
    let office = Office::file().canonicalize().expect("it is there");
    let domain = office.ancestors().nth(2).expect("a folder").join("domains/smart-office");
    let domain = domain.display();
    // A short maximum between reconnects, so that two hundred faults fit into a short time.
    let mut text = format!(
        "[ecosystem]\nname = \"lab\"\ndomain = \"{domain}/domain.pddl\"\n\
         problem = \"{domain}/map.pddl\"\nmode = \"{mode}\"\ndaemons = [\"desk\"]\n\n\
         [zenoh]\nlisten.endpoints = [\"tls/0.0.0.0:7447\"]\n\
         connect.retry.period_max_ms = 500\n\n"
    );
    for (agent, plugin, daemons) in agents() {
        let start = if agent == ROBOT { "config = { start = \"corridor\" }\n" } else { "" };
        text += &format!(
            "[[agent]]\nname = \"{agent}\"\nplugin = \"{plugin}\"\ndaemon = {daemons:?}\n{start}\n"
        );
    }
    text
}

/// The building that matches the office's map.
fn layout() -> Layout {
    let mut layout = Layout::new();
    layout.add_corridor("corridor", 19.0).expect("a corridor");
    for (room, meters) in [("office1", 4.0), ("office2", 6.0), ("conf-room", 8.0)] {
        layout.add_room(room, 20.0).expect("a room");
        layout.connect("corridor", room, meters).expect("a door");
    }
    layout.add_robot(ROBOT, "corridor", 0.3).expect("a robot");
    layout
}
