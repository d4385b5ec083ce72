//! All key expressions of an ecosystem: how they are built, and how they are parsed.
//!
//! There is one constructor and one parser per row of the table in docs/design.md, “Key
//! expressions”. Chunks are plain text, so that any Zenoh tool can listen. Parsers return `None`
//! for a key that is not valid, because keys come from outside, where any client can write
//! anything.
//!
//! The argument `telling` is the number of times that a session has made all its declarations
//! again; see `declarations`.

use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Performative};
use substrate::{AgentAddress, Destination, Resident, Resource, Subject};
use zenoh::key_expr::KeyExpr;

/// Last chunk of the key of a receipt, in the place where the key of a message has the
/// performative.
const RECEIPT: &str = "receipt";

/// Last chunk of the key of a probe (whether a daemon can be reached), in the place where the key
/// of a question has the resource.
const REACH: &str = "reach";

/// Number of digits of the longest id of a Zenoh session.
const ZID_DIGITS_MAX: usize = 32;

/// Name of the selector parameter that contains the agent that a question is about.
pub(crate) const AGENT_PARAMETER: &str = "agent";

/// The key expressions of one daemon in one ecosystem.
#[derive(Clone, Debug)]
pub(crate) struct KeySpace {
    /// Root of all keys: `althing/{ecosystem}`.
    root: String,
    daemon: DaemonId,
    /// Whether this session is that of a guest: a short-lived one, such as that of a command.
    is_guest: bool,
}

// === building ===

impl KeySpace {
    pub(crate) fn new(ecosystem: &EcosystemId, daemon: DaemonId) -> KeySpace {
        KeySpace { root: format!("althing/{ecosystem}"), daemon, is_guest: false }
    }

    /// Returns keys with which a guest subscribes to the same messages as a daemon. The key
    /// expressions match the same keys, but are written differently.
    ///
    /// Zenoh 1.10.2 keeps its records of a closed link for as long as another link declares a key
    /// expression of the same text. Daemons keep theirs declared for ever, so one command each
    /// minute would fill the memory of a board.
    pub(crate) fn of_guest(self) -> KeySpace {
        KeySpace { is_guest: true, ..self }
    }

    /// Whether this session is that of a guest.
    pub(crate) fn is_guest(&self) -> bool {
        self.is_guest
    }

    /// Returns the name of this daemon.
    pub(crate) fn daemon(&self) -> &DaemonId {
        &self.daemon
    }

    /// Builds `in/{daemon}/{agent}/{performative}`: the key of a message to one agent.
    pub(crate) fn to_one(&self, to: &AgentAddress, subject: Subject) -> KeyExpr<'static> {
        let what = match subject {
            Subject::Message(performative) => performative.as_str(),
            Subject::Receipt => RECEIPT,
        };
        self.build(&["in", to.daemon.as_str(), to.agent.as_str(), what])
    }

    /// Builds `all/{performative}/{sender}`: the key of a message to all agents.
    pub(crate) fn to_all(&self, sender: &AgentId, performative: Performative) -> KeyExpr<'static> {
        self.build(&["all", performative.as_str(), sender.as_str()])
    }

    /// Builds `alive/{daemon}/{agent}/{incarnation}`: the key of the token for the presence of one
    /// agent of this daemon. If `telling`, the number of times that the declaration was repeated,
    /// is not 0, it is added as one more chunk.
    pub(crate) fn alive(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
        telling: u64,
    ) -> KeyExpr<'static> {
        let (incarnation, telling) = (incarnation.to_string(), telling.to_string());
        let chunks = ["alive", self.daemon.as_str(), agent.as_str(), &incarnation, &telling];
        self.build(if telling == "0" { &chunks[..4] } else { &chunks })
    }

    /// Builds `session/{daemon}/{zid}/{telling}`: the key of the token for the presence of one
    /// Zenoh session. `telling` is the number of times that the declaration was repeated.
    pub(crate) fn own_session(&self, zid: &str, telling: u64) -> KeyExpr<'static> {
        self.build(&["session", self.daemon.as_str(), zid, &telling.to_string()])
    }

    /// Builds `model/{daemon}/{agent}`: the key of the action model of one agent of this daemon.
    pub(crate) fn model(&self, agent: &AgentId) -> KeyExpr<'static> {
        self.build(&["model", self.daemon.as_str(), agent.as_str()])
    }

    /// Builds `model/{daemon}`: the key of a batch of heartbeats of several agents of this daemon.
    pub(crate) fn models_together(&self) -> KeyExpr<'static> {
        self.build(&["model", self.daemon.as_str()])
    }

    /// Builds `at/{daemon}/{resource}`: the key of a resource of this daemon.
    pub(crate) fn at(&self, resource: Resource) -> KeyExpr<'static> {
        self.build(&["at", self.daemon.as_str(), resource.as_str()])
    }

    /// Builds `at/{daemon}/reach`: the key of a probe, which tests whether a daemon can be reached.
    /// This crate answers probes.
    pub(crate) fn reach(&self, daemon: &DaemonId) -> KeyExpr<'static> {
        self.build(&["at", daemon.as_str(), REACH])
    }

    /// Builds an expression that matches every message to an agent of this daemon.
    pub(crate) fn inbox(&self) -> KeyExpr<'static> {
        self.build(&["in", self.daemon.as_str(), "**"])
    }

    /// Builds an expression that matches every message to all agents. `telling` is the number of
    /// times that the declaration was repeated. Even and odd numbers give two texts with the same
    /// meaning; see `declarations`.
    pub(crate) fn every_broadcast(&self, telling: u64) -> KeyExpr<'static> {
        match (self.is_guest, telling.is_multiple_of(2)) {
            (false, true) => self.build(&["all", "**"]),
            (false, false) => self.build(&["all", "*", "**"]),
            (true, true) => self.build(&["all", "*", "*"]),
            (true, false) => self.build(&["all", "*", "*", "**"]),
        }
    }

    /// Builds expressions that match the action models and heartbeats of all agents, both single
    /// heartbeats and batches.
    pub(crate) fn every_model(&self, telling: u64) -> Vec<KeyExpr<'static>> {
        match (self.is_guest, telling.is_multiple_of(2)) {
            (false, true) => vec![self.build(&["model", "**"])],
            (false, false) => vec![self.build(&["model", "*", "**"])],
            (true, true) => vec![self.build(&["model", "*"]), self.build(&["model", "*", "*"])],
            (true, false) => {
                vec![self.build(&["model", "*"]), self.build(&["model", "*", "*", "**"])]
            }
        }
    }

    /// Builds an expression that matches all messages of the ecosystem.
    pub(crate) fn everything(&self) -> KeyExpr<'static> {
        self.build(&["**"])
    }

    /// Builds `revoked`: the key of the list of revoked certificates, which is sent to all daemons.
    pub(crate) fn revoked(&self) -> KeyExpr<'static> {
        self.build(&["revoked"])
    }

    /// Builds an expression to subscribe to [`KeySpace::revoked`]. The expression is one of two
    /// texts with the same meaning, depending on whether `telling`, the number of times that the
    /// declaration was repeated, is even or odd.
    pub(crate) fn every_revocation(&self, telling: u64) -> KeyExpr<'static> {
        if telling.is_multiple_of(2) { self.revoked() } else { self.build(&["revoked", "**"]) }
    }

    /// Builds an expression that matches the session tokens of all daemons.
    pub(crate) fn every_session(&self) -> KeyExpr<'static> {
        if self.is_guest {
            self.build(&["session", "*", "*", "*"])
        } else {
            self.build(&["session", "**"])
        }
    }

    /// Builds the expression of a roll call: a probe of all daemons.
    pub(crate) fn everyone_reached(&self) -> KeyExpr<'static> {
        self.build(&["at", "*", REACH])
    }

    /// Builds an expression that matches the presence tokens of all agents.
    pub(crate) fn everyone_alive(&self) -> KeyExpr<'static> {
        if self.is_guest {
            self.build(&["alive", "*", "*", "*", "**"])
        } else {
            self.build(&["alive", "**"])
        }
    }

    /// Builds an expression that matches all resources that this daemon can be asked for, except
    /// its models.
    pub(crate) fn own_resources(&self) -> KeyExpr<'static> {
        self.build(&["at", self.daemon.as_str(), "*"])
    }

    /// Builds an expression that matches the action models that this daemon can be asked for.
    pub(crate) fn own_models(&self) -> KeyExpr<'static> {
        self.build(&["model", self.daemon.as_str(), "*"])
    }

    /// Builds the key expression of a question to `daemon`. If `daemon` is `None`, the question
    /// goes to all daemons, and each of them answers under its own key.
    pub(crate) fn query(
        &self,
        daemon: Option<&DaemonId>,
        resource: Resource,
        agent: Option<&AgentId>,
    ) -> KeyExpr<'static> {
        let daemon = daemon.map_or("*", DaemonId::as_str);
        match resource {
            Resource::Model => self.build(&["model", daemon, agent.map_or("*", AgentId::as_str)]),
            _ => self.build(&["at", daemon, resource.as_str()]),
        }
    }

    /// Returns the agent of this daemon that is named in the key of a query for a single model;
    /// `None` for any other key.
    pub(crate) fn asked_for(&self, key: &str) -> Option<AgentId> {
        match self.chunks(key)?.as_slice() {
            ["model", daemon, agent] if *daemon == self.daemon.as_str() => AgentId::new(agent).ok(),
            _ => None,
        }
    }

    fn build(&self, chunks: &[&str]) -> KeyExpr<'static> {
        let text = format!("{}/{}", self.root, chunks.join("/"));
        KeyExpr::try_from(text).expect("invariant: names, numbers and wildcards are chunks")
    }
}

// === reading ===

impl KeySpace {
    /// Returns how the message with this key was addressed; `None` if the message is not for this
    /// daemon.
    pub(crate) fn addressed(&self, key: &str) -> Option<Destination> {
        match self.chunks(key)?.as_slice() {
            ["in", daemon, agent, what] if *daemon == self.daemon.as_str() => {
                Some(Destination::To(AgentId::new(agent).ok()?, subject(what)?))
            }
            ["all", performative, sender] => {
                Some(Destination::All(AgentId::new(sender).ok()?, performative.parse().ok()?))
            }
            ["model", daemon, agent] => {
                DaemonId::new(daemon).ok()?;
                Some(Destination::AgentState(AgentId::new(agent).ok()?))
            }
            _ => None,
        }
    }

    /// Returns how the message with this key was addressed, whichever daemon it is for, and that
    /// daemon, `None` if it is for all; `None` for the key of a receipt or of anything else.
    pub(crate) fn overheard<'key>(
        &self,
        key: &'key str,
    ) -> Option<(Destination, Option<&'key str>)> {
        match self.chunks(key)?.as_slice() {
            ["in", daemon, agent, what] => {
                DaemonId::new(daemon).ok()?;
                let Subject::Message(performative) = subject(what)? else { return None };
                let agent = AgentId::new(agent).ok()?;
                Some((Destination::To(agent, Subject::Message(performative)), Some(daemon)))
            }
            _ => self.addressed(key).map(|destination| (destination, None)),
        }
    }

    /// Whether the message with this key is a batch of heartbeats.
    pub(crate) fn is_together(&self, key: &str) -> bool {
        matches!(self.chunks(key).as_deref(), Some(["model", daemon]) if DaemonId::new(daemon).is_ok())
    }

    /// Returns the agent that is declared present by the liveliness token with this key, and the
    /// number of times that the declaration was repeated; `None` for any other key.
    pub(crate) fn resident(&self, key: &str) -> Option<(Resident, u64)> {
        let chunks = self.chunks(key)?;
        let ["alive", daemon, agent, incarnation, telling @ ..] = chunks.as_slice() else {
            return None;
        };
        let telling = match telling {
            [] => 0,
            [telling] => number(telling).filter(|&telling| telling > 0)?,
            _ => return None,
        };
        let resident = Resident {
            agent: AgentId::new(agent).ok()?,
            daemon: DaemonId::new(daemon).ok()?,
            incarnation: Incarnation(number(incarnation)?),
        };
        Some((resident, telling))
    }

    /// Returns the Zenoh id of the session that is declared present by the liveliness token with
    /// this key, and the number of times that the declaration was repeated; `None` for any other
    /// key.
    pub(crate) fn session<'key>(&self, key: &'key str) -> Option<(&'key str, u64)> {
        let chunks = self.chunks(key)?;
        let ["session", daemon, zid, telling] = chunks.as_slice() else { return None };
        DaemonId::new(daemon).ok()?;
        let is_hex = |digit: u8| digit.is_ascii_digit() || (b'a'..=b'f').contains(&digit);
        // Every answer to a roll call lists the ids, so their length is bounded.
        let is_id = (1..=ZID_DIGITS_MAX).contains(&zid.len()) && zid.bytes().all(is_hex);
        is_id.then_some((*zid, number(telling)?))
    }

    /// Returns the daemon that answered a probe, from the key of the answer; `None` for any other
    /// key.
    pub(crate) fn reached(&self, key: &str) -> Option<DaemonId> {
        match self.chunks(key)?.as_slice() {
            ["at", daemon, REACH] => DaemonId::new(daemon).ok(),
            _ => None,
        }
    }

    /// Returns the only daemon that may send messages with this key; `None` if there is no such
    /// restriction.
    pub(crate) fn only_sender<'key>(&self, key: &'key str) -> Option<&'key str> {
        match self.chunks(key)?.as_slice() {
            ["model" | "at", daemon, _] | ["model", daemon] => Some(daemon),
            _ => None,
        }
    }

    /// Returns the resource and the agent that the answer with this key is about; `None` if the key
    /// is not one of an answer.
    pub(crate) fn answered_resource(&self, key: &str) -> Option<(Resource, Option<AgentId>)> {
        match self.chunks(key)?.as_slice() {
            ["model", _, agent] => Some((Resource::Model, AgentId::new(agent).ok())),
            ["at", _, what] => {
                let resource = Resource::ALL.into_iter().find(|each| each.as_str() == *what)?;
                Some((resource, None))
            }
            _ => None,
        }
    }

    /// Returns the chunks of `key` below the ecosystem's root; `None` if it has another root.
    fn chunks<'key>(&self, key: &'key str) -> Option<Vec<&'key str>> {
        let below = key.strip_prefix(self.root.as_str())?.strip_prefix('/')?;
        Some(below.split('/').collect())
    }
}

fn subject(what: &str) -> Option<Subject> {
    match what {
        RECEIPT => Some(Subject::Receipt),
        performative => performative.parse().ok().map(Subject::Message),
    }
}

/// Parses a number only in the spelling that [`KeySpace::alive`] writes. If `7` and `007` were the
/// same incarnation, the removal of one token would remove the other.
fn number(chunk: &str) -> Option<u64> {
    let number: u64 = chunk.parse().ok()?;
    (number.to_string() == chunk).then_some(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys() -> KeySpace {
        KeySpace::new(&EcosystemId::new("office").expect("a name"), daemon("pi"))
    }

    fn daemon(name: &str) -> DaemonId {
        DaemonId::new(name).expect("a name")
    }

    fn agent(name: &str) -> AgentId {
        AgentId::new(name).expect("a name")
    }

    #[test]
    fn every_documented_row_has_its_key() {
        let (keys, robot) = (keys(), agent("robot"));
        let to = AgentAddress { daemon: daemon("pi"), agent: robot.clone() };
        let request = Subject::Message(Performative::Request);
        let rows = [
            (keys.to_one(&to, request), "in/pi/robot/request"),
            (keys.to_one(&to, Subject::Receipt), "in/pi/robot/receipt"),
            (keys.to_all(&robot, Performative::Cfp), "all/cfp/robot"),
            (keys.alive(&robot, Incarnation(7), 0), "alive/pi/robot/7"),
            (keys.alive(&robot, Incarnation(7), 2), "alive/pi/robot/7/2"),
            (keys.own_session("a1", 0), "session/pi/a1/0"),
            (keys.everyone_reached(), "at/*/reach"),
            (keys.model(&robot), "model/pi/robot"),
            (keys.models_together(), "model/pi"),
            (keys.at(Resource::Goals), "at/pi/goals"),
            (keys.reach(&daemon("x")), "at/x/reach"),
            (keys.inbox(), "in/pi/**"),
            (keys.query(None, Resource::State, Some(&robot)), "at/*/state"),
            (keys.query(None, Resource::Model, None), "model/*/*"),
            (keys.query(Some(&daemon("x")), Resource::Model, Some(&robot)), "model/x/robot"),
        ];
        for (key_expr, expected) in rows {
            assert_eq!(key_expr.as_str(), format!("althing/office/{expected}"));
        }
    }

    /// A guest subscribes to the same messages as a daemon, but never with a key expression of the
    /// same text.
    #[test]
    fn guests_receive_the_same_under_other_key_expressions() {
        let (daemons, guests) = (keys(), keys().of_guest());
        let robot = agent("robot");
        let heard = |keys: &KeySpace| {
            let mut heard = vec![keys.every_session(), keys.everyone_alive()];
            for telling in [0, 1] {
                heard.push(keys.every_broadcast(telling));
                heard.extend(keys.every_model(telling));
            }
            heard
        };
        for of_guest in heard(&guests) {
            assert!(!heard(&daemons).contains(&of_guest), "{of_guest}");
        }
        let said = [
            daemons.to_all(&robot, Performative::Cfp),
            daemons.model(&robot),
            daemons.models_together(),
            daemons.own_session("a1", 3),
            daemons.alive(&robot, Incarnation(7), 0),
            daemons.alive(&robot, Incarnation(7), 2),
        ];
        for keys in [&daemons, &guests] {
            for telling in [0, 1] {
                let subscribed = [vec![keys.every_broadcast(telling)], keys.every_model(telling)];
                let mut subscribed = subscribed.concat();
                subscribed.extend([keys.every_session(), keys.everyone_alive()]);
                for key in &said {
                    let times = subscribed.iter().filter(|each| each.intersects(key)).count();
                    assert_eq!(times, 1, "{key}, {telling}");
                }
            }
        }
    }

    #[test]
    fn built_keys_can_be_parsed() {
        let (keys, robot) = (keys(), agent("robot"));
        let to = AgentAddress { daemon: daemon("pi"), agent: robot.clone() };
        for subject in Performative::ALL.map(Subject::Message).into_iter().chain([Subject::Receipt])
        {
            let read = keys.addressed(&keys.to_one(&to, subject));
            assert_eq!(read, Some(Destination::To(robot.clone(), subject)));
        }
        let cfp = keys.addressed(&keys.to_all(&robot, Performative::Cfp));
        assert_eq!(cfp, Some(Destination::All(robot.clone(), Performative::Cfp)));
        assert_eq!(
            keys.addressed(&keys.model(&robot)),
            Some(Destination::AgentState(robot.clone()))
        );
        let incarnation = Incarnation(u64::MAX);
        let resident = Resident { agent: robot.clone(), daemon: daemon("pi"), incarnation };
        for telling in [0, 1, u64::MAX] {
            let key = keys.alive(&robot, incarnation, telling);
            assert_eq!(keys.resident(&key), Some((resident.clone(), telling)));
            let key = keys.own_session("a1", telling);
            assert_eq!(keys.session(&key), Some(("a1", telling)));
        }
        assert_eq!(keys.reached(&keys.reach(&daemon("x"))), Some(daemon("x")));
    }

    #[test]
    fn malformed_keys_are_ignored() {
        for garbage in [
            "",
            "/",
            "althing",
            "althing/office",
            "althing/office/",
            "althing/officer/in/pi/robot/request",
            "althing/office/in/pi",
            "althing/office/in/pi/robot/request/more",
            "althing/office/in/other/robot/request",
            "althing/office/in/pi/Robot/request",
            "althing/office/in/pi/*/request",
            "althing/office/in/pi/robot/shout",
            "althing/office/all/receipt/robot",
            "althing/office/all/cfp/**",
            "althing/office/model/Pi/robot",
            "althing/office/alive/pi/robot/7",
        ] {
            assert_eq!(keys().addressed(garbage), None, "{garbage}");
        }
        for garbage in [
            "",
            "-1",
            "+7",
            "007",
            "7.0",
            "*",
            "18446744073709551616",
            "7/",
            "7/0",
            "7/01",
            "7/1/1",
        ] {
            let key = format!("althing/office/alive/pi/robot/{garbage}");
            assert_eq!(keys().resident(&key), None, "{garbage}");
        }
        let long = format!("session/pi/{}/0", "a".repeat(ZID_DIGITS_MAX + 1));
        for garbage in [
            "session/pi/a1",
            "session/Pi/a1/0",
            "session/pi/a1/00",
            "session/pi/a1/0/0",
            "session/pi/A1/0",
            "session/pi/one/0",
            &long,
        ] {
            assert_eq!(keys().session(&format!("althing/office/{garbage}")), None, "{garbage}");
        }
    }
}
