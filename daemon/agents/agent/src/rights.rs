//! Rights in a secured ecosystem, as the ecosystem file states them: which daemon may host which
//! agents, which actions these agents may advertise, and which agents may ask for goals. This
//! module has data and decisions; the module `authorization` enforces them.

use std::collections::{BTreeMap, BTreeSet};

use acl::content::{ChangeState, Request};
use acl::{AgentId, DaemonId};

/// Rights that the ecosystem file grants.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rights {
    /// The agents that the ecosystem file names, each with its rights.
    pub agents: BTreeMap<AgentId, AgentRights>,
    /// Daemons through which people take part. These daemons may host agents that the ecosystem
    /// file does not name, if those agents offer no actions.
    pub guests: AllowedNames<DaemonId>,
    /// Daemons that may host agents with actions even if the ecosystem file does not name these
    /// agents.
    pub newcomers: AllowedNames<DaemonId>,
    /// Agents that may ask for goals, plans and actions.
    pub goals: AllowedRequesters,
    /// Agents that may change facts, and may change how plans are made.
    pub changes: AllowedRequesters,
    /// Agents that may read what happened.
    pub history: AllowedRequesters,
    /// Agents that may read what happened to facts that their agents declare private.
    pub private: AllowedRequesters,
}

/// Rights of one agent: where it may run, and which actions it may advertise.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AgentRights {
    /// Daemons that may host the agent; if empty, any daemon may.
    pub daemons: BTreeSet<DaemonId>,
    /// Actions that the agent may advertise, in lower case; `None` if it may advertise any action.
    pub actions: Option<BTreeSet<String>>,
    /// Whether the agent is a reasoning agent, such as the Plan Requester: it acts on requests of
    /// other agents, and is trusted to make any request itself.
    pub reasons: bool,
}

/// A set of allowed names, or all names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AllowedNames<T> {
    /// Every name is allowed.
    All,
    /// Only the names in this set.
    These(BTreeSet<T>),
}

/// Agents that may make a certain kind of request. Reasoning agents always may.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AllowedRequesters {
    /// Every agent may make the request.
    All,
    /// Only the agents that the fields describe.
    These {
        /// Agents that the ecosystem file names and that may make the request.
        agents: BTreeSet<AgentId>,
        /// Whether agents that the ecosystem file does not name may make the request: people at
        /// command lines and keyboards.
        guests: bool,
    },
}

// === impl Rights ===

impl Rights {
    /// Checks whether `daemon` may host an agent. `daemon` may also be a guest of a daemon that the
    /// ecosystem file names, such as the short-lived daemon of a command.
    ///
    /// # Errors
    ///
    /// Returns the reason, for a person, if the daemon may not host the agent.
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

    /// Whether the rights limit the actions that `agent`, hosted by `daemon`, may advertise. If so,
    /// the actions must be checked.
    pub fn limits_actions(&self, agent: &AgentId, daemon: &DaemonId) -> bool {
        match self.agents.get(agent) {
            Some(rights) => rights.actions.is_some(),
            None => !self.newcomers.has(daemon.host()),
        }
    }

    /// Checks whether `agent`, hosted by `daemon`, may advertise these actions.
    ///
    /// # Errors
    ///
    /// Returns the reason, for a person, if the agent may not. If the ecosystem file names the
    /// agent, the reason lists the actions that are not allowed.
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

    /// Checks whether an agent may make this request.
    ///
    /// # Errors
    ///
    /// Returns the reason, for a person, if the agent may not make the request.
    pub fn may_ask(&self, agent: &AgentId, request: &Request) -> Result<(), String> {
        match request {
            Request::Achieve(_)
            | Request::Schedule(_)
            | Request::Plan(_)
            | Request::Execute(_)
            | Request::CancelPlan(_)
            | Request::Act(_) => self.may_ask_for_goals(agent),
            // The Plan Executor reports the effects of an action in the name of the agent that
            // acted.
            Request::ChangeState(ChangeState { owner: Some(owner), .. })
                if owner != agent && !self.may_reason(agent) =>
            {
                Err(format!("`{agent}` may not change things in the name of `{owner}`"))
            }
            Request::ChangeState(_)
            | Request::SetMode(_)
            | Request::ChangeMetric(_)
            | Request::ChangeActions(_)
            | Request::ReleaseStops(_) => {
                self.may(&self.changes, agent, "change things", "changes")
            }
            Request::StoreRecords(_) if !self.may_reason(agent) => Err(format!(
                "`{agent}` is no reasoning agent, and only those write to the Journals"
            )),
            Request::StoreRecords(_) => Ok(()),
            // A stop is safe, and must not fail because of a missing right.
            Request::Stop(_) => Ok(()),
            // Sensors and robots report what they observe. An observation takes precedence over
            // what other agents claim, so for an agent that the file does not name it counts as a
            // change.
            Request::Observe(_) if self.agents.contains_key(agent) => Ok(()),
            Request::Observe(_) => self.may(&self.changes, agent, "change things", "changes"),
            // A person's answer decides what is done, and which agents are admitted.
            Request::AnswerQuestion(_) => {
                self.may(&self.goals, agent, "answer for people", "goals")
            }
            // The history withholds what is private by itself: see `may_read_private`.
            Request::ReadHistory(_) => {
                self.may(&self.history, agent, "read what happened", "history")
            }
        }
    }

    /// Whether an agent may read what happened to facts that their agents declare private.
    pub fn may_read_private(&self, agent: &AgentId) -> bool {
        self.may(&self.private, agent, "read what is private", "private").is_ok()
    }

    /// Checks whether an agent may ask for goals, plans and actions.
    ///
    /// # Errors
    ///
    /// Returns the reason, for a person, if the agent may not ask for goals, plans and actions.
    pub fn may_ask_for_goals(&self, agent: &AgentId) -> Result<(), String> {
        self.may(&self.goals, agent, "ask for goals and actions", "goals")
    }

    /// Whether `agent` is one of the ecosystem's reasoning agents. If the ecosystem file names no
    /// reasoning agent, every agent counts as one.
    pub fn may_reason(&self, agent: &AgentId) -> bool {
        let reasons = |rights: &AgentRights| rights.reasons;
        self.agents.get(agent).is_some_and(reasons) || !self.agents.values().any(reasons)
    }

    /// Whether a daemon may host reasoning agents. Every daemon may if the ecosystem file names no
    /// reasoning agent.
    pub fn may_host_reasoning(&self, daemon: &DaemonId) -> bool {
        let reasoning = || self.agents.values().filter(|rights| rights.reasons);
        let here =
            |rights: &AgentRights| rights.daemons.is_empty() || rights.daemons.contains(daemon);
        !daemon.is_guest() && reasoning().any(here) || reasoning().next().is_none()
    }

    fn may(
        &self,
        who: &AllowedRequesters,
        agent: &AgentId,
        what: &str,
        key: &str,
    ) -> Result<(), String> {
        let named = self.agents.get(agent);
        let may = match who {
            AllowedRequesters::All => true,
            AllowedRequesters::These { agents, guests } => {
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

impl<T: Ord + std::borrow::Borrow<str>> AllowedNames<T> {
    /// Whether `name` is allowed.
    pub fn has(&self, name: &str) -> bool {
        match self {
            AllowedNames::All => true,
            AllowedNames::These(these) => these.contains(name),
        }
    }
}

impl<T> Default for AllowedNames<T> {
    fn default() -> AllowedNames<T> {
        AllowedNames::These(BTreeSet::new())
    }
}

impl Default for AllowedRequesters {
    fn default() -> AllowedRequesters {
        AllowedRequesters::These { agents: BTreeSet::new(), guests: false }
    }
}

#[cfg(test)]
mod tests {
    use acl::content::{
        Achieve, AnswerQuestion, HistoryQuery, Keep, Observation, PersonsAnswer, ReadHistory,
        ReleaseStops, Stop,
    };

    use super::*;

    fn agent(name: &str) -> AgentId {
        AgentId::new(name).expect("a name")
    }

    fn daemon(name: &str) -> DaemonId {
        DaemonId::new(name).expect("a name")
    }

    /// Rights for a test: a robot on either of two boards, a requester, a camera that may ask for
    /// goals, and people at a guest daemon.
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
            guests: AllowedNames::These([daemon("desk")].into()),
            newcomers: AllowedNames::These([daemon("gate")].into()),
            goals: AllowedRequesters::These { agents: [agent("camera")].into(), guests: true },
            changes: AllowedRequesters::These { agents: BTreeSet::new(), guests: false },
            history: AllowedRequesters::These { agents: [agent("robot")].into(), guests: true },
            private: AllowedRequesters::These { agents: [agent("camera")].into(), guests: false },
        }
    }

    #[test]
    fn each_agent_runs_on_its_own_daemons_only() {
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
    fn each_agent_advertises_allowed_actions_only() {
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
    fn each_agent_may_stop_and_only_some_may_release() {
        let stop = Request::Stop(Stop {
            id: "one".to_owned(),
            scope: Vec::new(),
            by: agent("anyone"),
            why: String::new(),
        });
        let release = Request::ReleaseStops(ReleaseStops { ids: vec!["one".to_owned()] });
        for (who, may_release) in [("requester", true), ("robot", false), ("visitor", false)] {
            assert_eq!(rights().may_ask(&agent(who), &stop), Ok(()), "{who}");
            assert_eq!(rights().may_ask(&agent(who), &release).is_ok(), may_release, "{who}");
        }
    }

    #[test]
    fn each_agent_makes_allowed_requests_only() {
        let goal = Request::Achieve(Achieve {
            goal: "(clean hall)".to_owned(),
            keep: Keep::Achieve,
            priority: 0,
            partition: Default::default(),
        });
        let change = Request::ChangeState(ChangeState::default());
        let observation = Request::Observe(Observation::default());
        let (question, answer) = (1, PersonsAnswer::plain("yes"));
        let answer = Request::AnswerQuestion(AnswerQuestion { question, answer });
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
        let open =
            Rights { goals: AllowedRequesters::All, changes: AllowedRequesters::All, ..rights() };
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
    fn what_happened_is_read_by_some_and_what_is_private_by_fewer() {
        let subject = "(lit hall)".to_owned();
        let read = Request::ReadHistory(ReadHistory::new(HistoryQuery::Why { subject }));
        for (who, may_read, may_read_private) in [
            ("requester", true, true),
            ("robot", true, false),
            ("camera", false, true),
            ("person", true, false),
        ] {
            let may = rights().may_ask(&agent(who), &read);
            assert_eq!(may.is_ok(), may_read, "{who}: {may:?}");
            assert_eq!(rights().may_read_private(&agent(who)), may_read_private, "{who}");
        }
    }

    #[test]
    fn only_reasoning_agents_may_reason() {
        let rights = rights();
        assert!(rights.may_reason(&agent("requester")) && !rights.may_reason(&agent("robot")));
        assert!(rights.may_host_reasoning(&daemon("hub")));
        assert!(!rights.may_host_reasoning(&daemon("robot-pi")));
        assert!(Rights::default().may_reason(&agent("robot")), "where the file names no agent");
    }
}
