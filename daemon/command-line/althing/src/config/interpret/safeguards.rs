//! The safeguards of actions: which a person must allow, and how often others may begin.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::AgentId;
use actuator::{ActionSafeguard, BEGINNINGS_MAX, BeginLimit, Safeguards};
use pddl::Diagnostic;

use super::Interpreter;
use super::files::PddlFiles;
use crate::config::ecosystem::AgentEntry;
use crate::config::raw::RawSafeguard;

/// How long people may take to allow an action, if the file does not say it: time to read the
/// question, and to look whether the way is clear.
const PATIENCE: Duration = Duration::from_secs(60);

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the safeguards of the file without those that have mistakes, which are reported.
    pub(super) fn safeguards(
        &mut self,
        raw: BTreeMap<String, BTreeMap<String, RawSafeguard>>,
        agents: &[AgentEntry],
        files: Option<&PddlFiles>,
    ) -> Safeguards {
        let mut all = BTreeMap::new();
        for (name, actions) in raw {
            let path = format!("safeguards.{name}");
            let agent = match AgentId::new(&name) {
                Ok(agent) => agent,
                Err(error) => {
                    let message = format!("`{name}` cannot be the name of {}", error.what);
                    let rule = error.rule;
                    self.about_key(&path, |span| Diagnostic::error(span, message).with_help(rule));
                    continue;
                }
            };
            if !self.may_be_agent(&path, &name, agents, files, "it is safeguarded if it appears") {
                continue;
            }
            let safeguarded = actions.into_iter().filter_map(|(action, raw)| {
                let path = format!("{path}.{action}");
                Some((action.to_lowercase(), self.safeguard(&path, &raw)?))
            });
            all.insert(agent, safeguarded.collect());
        }
        Safeguards(all)
    }

    fn safeguard(&mut self, path: &str, raw: &RawSafeguard) -> Option<ActionSafeguard> {
        let RawSafeguard { confirm, patience, at_most, per } = *raw;
        // A key with a wrong value is reported already, and is missing here.
        let is_written = |key: &str| self.place(&format!("{path}.{key}")).is_some();
        if (is_written("confirm") && !confirm && patience.is_some())
            || (is_written("at-most") && at_most.is_none())
            || (is_written("per") && per.is_none())
        {
            return None;
        }
        let problem = match (at_most, per) {
            (Some(at_most), _) if at_most > BEGINNINGS_MAX => Some((
                "`at-most` is greater than 1000, and that many beginnings are not counted",
                "leave the limit out, or choose a shorter `per`",
            )),
            (Some(_), None) => Some(("`at-most` needs `per`", "write per = \"1h\" beside it")),
            (None, Some(_)) => Some(("`per` needs `at-most`", "write at-most = 6 beside it")),
            _ if patience.is_some() && !confirm => {
                Some(("`patience` needs `confirm`", "write confirm = true beside it"))
            }
            (None, None) if !confirm => Some((
                "this safeguard has no effect",
                "write confirm = true, or at-most = 6 and per = \"1h\"",
            )),
            _ => None,
        };
        if let Some((message, help)) = problem {
            self.about_key(path, |span| Diagnostic::error(span, message).with_help(help));
            return None;
        }
        let limit = at_most.zip(per).map(|(at_most, per)| BeginLimit { at_most, per });
        let asks_people = confirm.then(|| patience.unwrap_or(PATIENCE));
        Some(ActionSafeguard { asks_people, limit })
    }

    /// Whether an agent may have this name. Reports an object of the map, which is no agent. Warns of
    /// an agent that the file does not name: it may be misspelled, or may be discovered later, with
    /// this consequence.
    pub(super) fn may_be_agent(
        &mut self,
        path: &str,
        name: &str,
        agents: &[AgentEntry],
        files: Option<&PddlFiles>,
        consequence: &str,
    ) -> bool {
        // What is wrong with the agent's own entry is reported there.
        if self.written_agents.contains(name)
            || agents.iter().any(|entry| entry.name.as_str() == name)
        {
            return true;
        }
        if files.is_some_and(|files| files.has_object(name)) {
            let message = format!("`{name}` is an object of the map, and no agent");
            let help = "name the agent that the table is about";
            self.about_key(path, |span| Diagnostic::error(span, message).with_help(help));
            return false;
        }
        let message = format!("no agent of this file is called `{name}`");
        let near = pddl::nearest(name, agents.iter().map(|entry| entry.name.as_str()));
        let help = match near {
            Some(near) => format!("did you mean `{near}`? otherwise {consequence}"),
            None => format!("{consequence}, such as a device of a gateway"),
        };
        self.about_key(path, |span| Diagnostic::warning(span, message).with_help(help));
        true
    }
}
