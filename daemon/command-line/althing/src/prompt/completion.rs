//! Completion by Tab: completes verbs, and the goals, actions, objects and agents that currently
//! exist.

use std::collections::{BTreeMap, BTreeSet};

use acl::content::Snapshot;
use phrases::KnownNames;

use super::verbs;
use crate::asking::known_names;
use crate::speech;

/// The words other than predicates with which a condition can begin.
const CONNECTIVES: [&str; 6] = ["and", "exists", "forall", "imply", "not", "or"];

/// The words that Tab can complete.
#[derive(Debug, Default)]
pub(super) struct CompletionWords {
    /// The names of goals in the ecosystem file.
    goals: Vec<String>,
    /// The names of the predicates of facts.
    predicates: Vec<String>,
    functions: Vec<String>,
    /// The names of the agents that offer an action, by the name of the action.
    actions: BTreeMap<String, BTreeSet<String>>,
    objects: Vec<String>,
    agents: Vec<String>,
    /// The names that goals in words may contain.
    names: KnownNames,
    /// The numbers of the requests that have not ended.
    pub(super) requests: Vec<String>,
    /// The numbers of the open questions.
    pub(super) questions: Vec<String>,
}

impl CompletionWords {
    /// Replaces the words by the current ones: goals, agents, and the words of the domain in
    /// `snapshot`. If `snapshot` is `None`, the words of the domain are kept.
    pub(super) fn renew(
        &mut self,
        snapshot: Option<&Snapshot>,
        goals: Vec<String>,
        agents: Vec<String>,
    ) {
        (self.goals, self.agents) = (goals, agents);
        let Some(snapshot) = snapshot else { return };
        self.names = known_names::of_snapshot(snapshot);
        if let Some(domain) = pddl::parse_domain(&snapshot.domain).value {
            let named = domain.predicates.iter().map(|predicate| predicate.name.to_string());
            // Names with two hyphens are not words for users: the Domain Maintainer generates them
            // for planners.
            self.predicates = named.filter(|name| !name.contains("--")).collect();
            self.functions =
                domain.functions.iter().map(|function| function.name.to_string()).collect();
            self.objects =
                domain.constants.iter().map(|constant| constant.name.to_string()).collect();
        }
        if let Some(problem) = pddl::parse_problem(&snapshot.problem).value {
            let named = problem.objects.iter().map(|object| object.object.name.to_string());
            self.objects.extend(named);
        }
        self.actions.clear();
        for (agent, actions) in &snapshot.offers {
            for action in actions.keys() {
                self.actions.entry(action.clone()).or_default().insert(agent.to_string());
            }
        }
    }

    /// Returns the possible completions of the word before the cursor, and the offset at which that
    /// word begins. `before` is the text before the cursor.
    pub(super) fn complete(&self, before: &str) -> (usize, Vec<String>) {
        if let Some((start, mut fitting)) = self.complete_phrase(before) {
            fitting.retain(|known| terminal::visible::is_plain(known));
            return (start, fitting);
        }
        let is_border = |character: char| character.is_whitespace() || character == '(';
        let start = before.rfind(is_border).map_or(0, |border| border + 1);
        let (context, word) = before.split_at(start);
        let mut fitting: Vec<String> =
            self.candidates(context).into_iter().filter(|known| known.starts_with(word)).collect();
        // The editor prints the words without escaping them, so words with special characters are
        // left out.
        fitting.retain(|known| terminal::visible::is_plain(known));
        fitting.sort();
        fitting.dedup();
        (start, fitting)
    }

    /// Completes a goal in words; `None` if the line is something else.
    fn complete_phrase(&self, before: &str) -> Option<(usize, Vec<String>)> {
        let line = before.trim_start();
        let first = line.split_whitespace().next().unwrap_or_default();
        let is_verb_whole = line.len() > first.len();
        let verbs = verbs::names();
        let (said, others): (&str, Vec<String>) = match line.strip_prefix("goal ") {
            Some(rest) => {
                let rest = rest.trim_start();
                let is_first = !rest.contains(char::is_whitespace);
                (rest, if is_first { self.goals.clone() } else { Vec::new() })
            }
            None if is_verb_whole && verbs.iter().any(|verb| verb == first) => return None,
            None if is_verb_whole => (line, Vec::new()),
            None => (line, verbs),
        };
        if said.starts_with(['(', '-']) || line.is_empty() || said.contains(" --") {
            return None;
        }
        let (start, mut fitting) = speech::complete(said, &self.names);
        fitting.extend(others.into_iter().filter(|other| other.starts_with(&said[start..])));
        fitting.sort();
        fitting.dedup();
        Some((before.len() - said.len() + start, fitting))
    }

    /// Returns all words that may follow the text `context`.
    fn candidates(&self, context: &str) -> Vec<String> {
        let line = context.trim_start();
        let verb = if line.starts_with('(') {
            "goal"
        } else {
            line.split(|character: char| character.is_whitespace() || character == '(')
                .next()
                .unwrap_or_default()
        };
        if line.is_empty() {
            return verbs::names();
        }
        match innermost(line) {
            Some(inside) => self.within(verb, inside),
            None => self.after(verb),
        }
    }

    /// Returns the words that may follow the verb `verb` outside parentheses.
    fn after(&self, verb: &str) -> Vec<String> {
        let own = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect();
        match verb {
            "goal" => {
                let mut words: Vec<String> =
                    own(&["--maintain", "--priority", "--partition", "--cancel"]);
                words.extend(self.goals.iter().cloned());
                words
            }
            "set" => own(&["--retract"]),
            "mode" => own(&["centralized", "decentralized"]),
            "answer" => self.questions.clone(),
            "cancel" => self.requests.clone(),
            "watch" => {
                let mut words: Vec<String> = own(&["--conversation", "--off"]);
                words.extend(self.requests.iter().cloned());
                words
            }
            "mailbox" => self.agents.clone(),
            "help" => verbs::names(),
            _ => Vec::new(),
        }
    }

    /// Returns the words that may follow within parentheses. `inside` is the text between the
    /// innermost open parenthesis and the cursor.
    fn within(&self, verb: &str, inside: &str) -> Vec<String> {
        let mut words = inside.split_whitespace();
        match (verb, words.next()) {
            ("act", None) => self.actions.keys().cloned().collect(),
            // The first argument of an action is the agent that acts.
            ("act", Some(action)) if words.next().is_none() => {
                self.actions.get(action).into_iter().flatten().cloned().collect()
            }
            (_, Some(_)) => self.objects.clone(),
            (_, None) => {
                let connectives = CONNECTIVES.map(str::to_owned).into_iter();
                let symbols = self.predicates.iter().chain(&self.functions).cloned();
                connectives.chain(symbols).collect()
            }
        }
    }
}

/// Returns the text after the last parenthesis that is still open; `None` if all are closed.
fn innermost(text: &str) -> Option<&str> {
    let mut open = Vec::new();
    for (at, character) in text.char_indices() {
        match character {
            '(' => open.push(at + 1),
            ')' => {
                open.pop();
            }
            _ => (),
        }
    }
    open.last().map(|at| &text[*at..])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vocabulary() -> CompletionWords {
        let own = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect();
        CompletionWords {
            goals: own(&["temperatures"]),
            predicates: own(&["at", "known-temperature"]),
            functions: own(&["distance"]),
            actions: [("move".to_owned(), ["turtlebot-1".to_owned()].into())].into(),
            objects: own(&["office1", "office2", "turtlebot-1"]),
            agents: own(&["plan-requester", "turtlebot-1"]),
            names: KnownNames::default(),
            requests: own(&["2"]),
            questions: own(&["7"]),
        }
    }

    #[track_caller]
    fn check(before: &str, expected: &[&str]) {
        let (start, words) = vocabulary().complete(before);
        assert_eq!(words, expected, "{before}");
        assert!(before.is_char_boundary(start));
    }

    #[test]
    fn verbs_come_first() {
        check("ag", &["agents"]);
        check("mod", &["mode"]);
    }

    #[test]
    fn each_verb_has_words_of_its_own() {
        check("goal temperatur", &["temperature", "temperatures"]);
        check("mode c", &["centralized"]);
        check("answer ", &["7"]);
        check("cancel ", &["2"]);
        check("mailbox p", &["plan-requester"]);
        check("set --", &["--retract"]);
    }

    #[test]
    fn a_goal_in_words_is_completed() {
        check("goal temperature of x kn", &["known"]);
        check("temperature of x kn", &["known"]);
        check("temperature of every room kn", &["known"]);
        check("tempera", &["temperature"]);
        check("goal temperature of x known --main", &["--maintain"]);
    }

    #[test]
    fn an_action_is_completed_by_agents_and_then_objects() {
        check("act (m", &["move"]);
        check("act (move ", &["turtlebot-1"]);
        check("act (move turtlebot-1 off", &["office1", "office2"]);
    }

    #[test]
    fn a_goal_is_completed_by_predicates_and_objects() {
        check("(kn", &["known-temperature"]);
        check("(and (known-temperature office1) (a", &["and", "at"]);
        check("goal (known-temperature office2", &["office2"]);
        check("set (= (dist", &["distance"]);
    }
}
