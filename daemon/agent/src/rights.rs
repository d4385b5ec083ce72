//! Who may do what in a secured ecosystem, as its file says: which daemon may host which agents,
//! what those may advertise, who may ask for goals. Data and decisions; `guard` enforces them.

use std::collections::{BTreeMap, BTreeSet};

use acl::content::{ChangeState, Request};
use acl::{AgentId, DaemonId};

/// What the ecosystem's file allows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rights {
    /// The agents that the file names.
    pub agents: BTreeMap<AgentId, AgentRights>,
    /// The daemons through which people take part: at them may be agents that the file does not
    /// name and that offer no actions.
    pub guests: Allowed<DaemonId>,
    /// The daemons that may bring agents with actions which the file does not name.
    pub newcomers: Allowed<DaemonId>,
    /// Who may ask for goals, plans and actions.
    pub goals: Askers,
    /// Who may change what is known, and how it is planned.
    pub changes: Askers,
}

/// What one agent may do.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AgentRights {
    /// The daemons that may host it; none is any.
    pub daemons: BTreeSet<DaemonId>,
    /// The actions it may advertise, in lower case; `None` is any.
    pub actions: Option<BTreeSet<String>>,
    /// Whether it is part of the reasoning, and so carries out what others may ask for.
    pub reasons: bool,
}

/// Some, or all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Allowed<T> {
    /// Everyone.
    All,
    /// Only these.
    These(BTreeSet<T>),
}

/// Who may ask for something; who is part of the reasoning always may.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Askers {
    /// Everyone.
    All,
    /// Only these.
    These {
        /// Agents that the file names.
        agents: BTreeSet<AgentId>,
        /// All that the file does not name: people at command lines and keyboards.
        guests: bool,
    },
}

// === impl Rights ===

impl Rights {
    /// Whether an agent may be at a daemon, which is one of the file, or a guest of one.
    ///
    /// # Errors
    ///
    /// Says why not.
    pub fn may_host(&self, agent: &AgentId, daemon: &DaemonId) -> Result<(), String> {
        match self.agents.get(agent) {
            Some(_) if daemon.is_guest() => {
                Err(format!("`{agent}` is one of the ecosystem's own agents, and no guest"))
            }
            Some(AgentRights { daemons, .. })
                if !daemons.is_empty() && !daemons.contains(daemon) =>
            {
                let daemons: Vec<_> = daemons.iter().map(|each| format!("`{each}`")).collect();
                Err(format!(
                    "the ecosystem's file gives `{agent}` to {}, not to `{daemon}`",
                    daemons.join(", ")
                ))
            }
            Some(_) => Ok(()),
            None if self.guests.has(daemon.host()) || self.newcomers.has(daemon.host()) => Ok(()),
            None => Err(format!(
                "the ecosystem's file does not name `{agent}`, and lets `{}` bring no other \
                 agent (`guests` and `newcomers` in [rights])",
                daemon.host()
            )),
        }
    }

    /// Whether what an agent of `daemon` may advertise has to be looked at.
    pub fn limits_actions(&self, agent: &AgentId, daemon: &DaemonId) -> bool {
        match self.agents.get(agent) {
            Some(rights) => rights.actions.is_some(),
            None => !self.newcomers.has(daemon.host()),
        }
    }

    /// Whether an agent of `daemon` may advertise these actions.
    ///
    /// # Errors
    ///
    /// Says which it may not.
    pub fn may_advertise<'a>(
        &self,
        agent: &AgentId,
        daemon: &DaemonId,
        actions: impl IntoIterator<Item = &'a str>,
    ) -> Result<(), String> {
        let actions = actions.into_iter().map(str::to_lowercase);
        let is_named = self.agents.contains_key(agent);
        let allowed = match self.agents.get(agent) {
            Some(rights) => rights.actions.as_ref(),
            None if self.newcomers.has(daemon.host()) => None,
            None => Some(const { &BTreeSet::new() }),
        };
        let Some(allowed) = allowed else { return Ok(()) };
        let beyond: Vec<_> = actions.filter(|action| !allowed.contains(action)).collect();
        match (beyond.as_slice(), is_named) {
            ([], _) => Ok(()),
            (beyond, true) => Err(format!(
                "the ecosystem's file does not let `{agent}` offer `{}` (`actions` of its entry)",
                beyond.join("`, `")
            )),
            (_, false) => Err(format!(
                "the ecosystem's file does not name `{agent}`, and lets `{}` bring no agent \
                 that offers actions (`newcomers` in [rights])",
                daemon.host()
            )),
        }
    }

    /// Whether an agent may ask for this.
    ///
    /// # Errors
    ///
    /// Says what it may not.
    pub fn may_ask(&self, agent: &AgentId, request: &Request) -> Result<(), String> {
        match request {
            Request::Achieve(_)
            | Request::Plan(_)
            | Request::Execute(_)
            | Request::CallOff(_)
            | Request::Act(_) => self.may_ask_for_goals(agent),
            // The Plan Executor reports the effects of an action in the name of the agent that acted.
            Request::ChangeState(ChangeState { owner: Some(owner), .. })
                if owner != agent && !self.may_reason(agent) =>
            {
                Err(format!("`{agent}` may not change things in the name of `{owner}`"))
            }
            Request::ChangeState(_)
            | Request::SetMode(_)
            | Request::ChangeMetric(_)
            | Request::ChangeActions(_) => {
                self.may(&self.changes, agent, "change things", "changes")
            }
            Request::Keep(_) if !self.may_reason(agent) => Err(format!(
                "`{agent}` is no reasoning agent, and only those write to the Journals"
            )),
            Request::Keep(_) => Ok(()),
            // Sensors and robots say what they see. What somebody has seen not to be so, nobody is
            // believed about any longer: of all others that is a change.
            Request::Observe(_) if self.agents.contains_key(agent) => Ok(()),
            Request::Observe(_) => self.may(&self.changes, agent, "change things", "changes"),
            // What a person answers decides what is done, and who comes in.
            Request::AnswerQuestion(_) => {
                self.may(&self.goals, agent, "answer for people", "goals")
            }
        }
    }

    /// Whether an agent may ask for goals, plans and actions.
    ///
    /// # Errors
    ///
    /// Says that it may not.
    pub fn may_ask_for_goals(&self, agent: &AgentId) -> Result<(), String> {
        self.may(&self.goals, agent, "ask for goals and actions", "goals")
    }

    /// Whether an agent speaks for the ecosystem's reasoning: where the file names such agents,
    /// they alone do.
    pub fn may_reason(&self, agent: &AgentId) -> bool {
        let reasons = |rights: &AgentRights| rights.reasons;
        self.agents.get(agent).is_some_and(reasons) || !self.agents.values().any(reasons)
    }

    /// Whether a daemon may host an agent that reasons.
    pub fn may_host_reasoning(&self, daemon: &DaemonId) -> bool {
        let reasoning = || self.agents.values().filter(|rights| rights.reasons);
        let here =
            |rights: &AgentRights| rights.daemons.is_empty() || rights.daemons.contains(daemon);
        !daemon.is_guest() && reasoning().any(here) || reasoning().next().is_none()
    }

    fn may(&self, who: &Askers, agent: &AgentId, what: &str, key: &str) -> Result<(), String> {
        let named = self.agents.get(agent);
        let may = match who {
            Askers::All => true,
            Askers::These { agents, guests } => {
                named.is_some_and(|rights| rights.reasons)
                    || agents.contains(agent)
                    || *guests && named.is_none()
            }
        };
        if may {
            return Ok(());
        }
        Err(format!("the ecosystem's file does not let `{agent}` {what} (`{key}` in [rights])"))
    }
}

impl<T: Ord + std::borrow::Borrow<str>> Allowed<T> {
    /// Whether this one is among them.
    pub fn has(&self, name: &str) -> bool {
        match self {
            Allowed::All => true,
            Allowed::These(these) => these.contains(name),
        }
    }
}

impl<T> Default for Allowed<T> {
    fn default() -> Allowed<T> {
        Allowed::These(BTreeSet::new())
    }
}

impl Default for Askers {
    fn default() -> Askers {
        Askers::These { agents: BTreeSet::new(), guests: false }
    }
}

#[cfg(test)]
mod tests {
    use acl::content::{Achieve, AnswerQuestion, Keep, Observation, PersonsAnswer};

    use super::*;

    fn agent(name: &str) -> AgentId {
        AgentId::new(name).expect("a name")
    }

    fn daemon(name: &str) -> DaemonId {
        DaemonId::new(name).expect("a name")
    }

    /// A robot on either of two boards, a requester, a camera that may ask, people at the desk.
    fn rights() -> Rights {
        let rights = |daemons: &[&str], actions: Option<&[&str]>, reasons| AgentRights {
            daemons: daemons.iter().map(|name| daemon(name)).collect(),
            actions: actions.map(|all| all.iter().map(|&name| name.to_owned()).collect()),
            reasons,
        };
        let agents = [
            ("robot", rights(&["robot-pi", "spare-pi"], Some(&["move", "dock"]), false)),
            ("requester", rights(&["hub"], None, true)),
            ("camera", rights(&["camera-pi"], None, false)),
            ("anywhere", rights(&[], None, false)),
        ];
        Rights {
            agents: agents.map(|(name, rights)| (agent(name), rights)).into(),
            guests: Allowed::These([daemon("desk")].into()),
            newcomers: Allowed::These([daemon("gate")].into()),
            goals: Askers::These { agents: [agent("camera")].into(), guests: true },
            changes: Askers::These { agents: BTreeSet::new(), guests: false },
        }
    }

    #[test]
    fn each_agent_has_its_place() {
        for (who, place, expected) in [
            ("robot", "robot-pi", true),
            ("robot", "spare-pi", true),
            ("robot", "camera-pi", false),
            ("robot", "robot-pi--cli-7", false),
            ("anywhere", "camera-pi", true),
            ("anywhere", "desk--cli-7", false),
            ("person", "desk--cli-7", true),
            ("person", "desk", true),
            ("person", "robot-pi--cli-7", false),
            ("visitor", "gate", true),
        ] {
            let may = rights().may_host(&agent(who), &daemon(place));
            assert_eq!(may.is_ok(), expected, "{who} at {place}: {may:?}");
        }
        let refused = rights().may_host(&agent("robot"), &daemon("hub")).expect_err("not there");
        assert_eq!(
            refused,
            "the ecosystem's file gives `robot` to `robot-pi`, `spare-pi`, not to `hub`"
        );
    }

    #[test]
    fn each_agent_offers_what_it_may() {
        for (who, place, actions, expected) in [
            ("robot", "robot-pi", vec!["move", "DOCK"], true),
            ("robot", "robot-pi", vec!["move", "open-vault"], false),
            ("camera", "camera-pi", vec!["look"], true),
            ("person", "desk--cli-7", vec!["open-vault"], false),
            ("person", "desk--cli-7", vec![], true),
            ("visitor", "gate", vec!["clean"], true),
        ] {
            let may = rights().may_advertise(&agent(who), &daemon(place), actions.iter().copied());
            assert_eq!(may.is_ok(), expected, "{who} {actions:?}: {may:?}");
        }
    }

    #[test]
    fn each_asks_for_what_it_may() {
        let goal = Request::Achieve(Achieve {
            goal: "(clean hall)".to_owned(),
            keep: Keep::Achieve,
            priority: 0,
            partition: Default::default(),
        });
        let change = Request::ChangeState(ChangeState::default());
        let observation = Request::Observe(Observation::default());
        let (question, said) = (1, PersonsAnswer::plain("yes"));
        let answer = Request::AnswerQuestion(AnswerQuestion { question, said });
        for (who, goals, changes, observes) in [
            ("camera", true, false, true),
            ("robot", false, false, true),
            ("requester", true, true, true),
            ("person", true, false, false),
        ] {
            let may = |request| rights().may_ask(&agent(who), request).is_ok();
            assert_eq!((may(&goal), may(&change)), (goals, changes), "{who}");
            assert_eq!((may(&answer), may(&observation)), (goals, observes), "{who}");
        }
        let open = Rights { goals: Askers::All, changes: Askers::All, ..rights() };
        assert!(open.may_ask(&agent("robot"), &change).is_ok());
        let of_robot = ChangeState { owner: Some(agent("robot")), ..ChangeState::default() };
        let of_robot = Request::ChangeState(of_robot);
        for (who, may) in
            [("robot", true), ("requester", true), ("camera", false), ("person", false)]
        {
            assert_eq!(open.may_ask(&agent(who), &of_robot).is_ok(), may, "{who}");
        }
    }

    #[test]
    fn reasoning_is_the_reasoners() {
        let rights = rights();
        assert!(rights.may_reason(&agent("requester")) && !rights.may_reason(&agent("robot")));
        assert!(rights.may_host_reasoning(&daemon("hub")));
        assert!(!rights.may_host_reasoning(&daemon("robot-pi")));
        assert!(Rights::default().may_reason(&agent("robot")), "where the file names no agent");
    }
}
