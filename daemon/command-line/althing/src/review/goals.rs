//! Checks the named goals of an ecosystem file against the ontology, the map, and the action models
//! of the agents in the file, which bring media, presets and predicates of their own.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use acl::AgentId;
use pddl::{
    ActionModel, Atom, Condition, Diagnostic, Domain, Effect, ObjectDeclaration, Problem, Severity,
    Span,
};

use super::Reviewer;
use crate::config::moved_goal;
use crate::hosting;

impl Reviewer<'_> {
    /// Reports words that are not declared, and wrong arguments, in the named goals of the file.
    pub(super) fn goals(&mut self) {
        if self.ecosystem.goals.is_empty() {
            return;
        }
        let models = hosting::models(self.ecosystem);
        let (domain, problem) = self.widened(&models);
        let agents = self.agents(&models);
        for (name, wish) in self.ecosystem.goals.iter() {
            // A goal that cannot be parsed is reported already.
            let read = pddl::parse_condition(&wish.goal).into_result();
            let Ok(condition) = read else { continue };
            let is_agent = |found: &Diagnostic| {
                let word = wish.goal.get(found.span.range()).unwrap_or("");
                agents.contains(&word.to_lowercase())
            };
            let is_written = self.is_written(name, &wish.goal);
            if let Some((message, help)) = without_content(&condition).filter(|_| is_written) {
                let found = Diagnostic::warning(Span::default(), message).with_help(help);
                self.report_value(&format!("goals.{name}.goal"), found);
                continue;
            }
            let mut found = pddl::check_condition(&domain, &problem, &condition);
            found.retain(|found| !is_agent(found));
            // In another order, the words are in wrong places, and no word is unknown.
            if let Some(ordered) = found.iter().find_map(|it| in_order(it, &domain, &condition)) {
                self.say_of_goal(name, &wish.goal, ordered);
                continue;
            }
            for found in found {
                let found = with_example(found, &problem);
                let found = explained_action(found, &models);
                if let Some(found) = self.softened(found) {
                    self.say_of_goal(name, &wish.goal, found);
                }
            }
        }
    }

    /// Returns the ontology and the map, extended from the action models.
    pub(super) fn widened(&self, models: &BTreeMap<AgentId, ActionModel>) -> (Domain, Problem) {
        widened(&self.ecosystem.domain, &self.ecosystem.problem, models.values())
    }

    /// Whether the text of a goal is the author's, and not that of a goal in words.
    fn is_written(&self, name: &str, goal: &str) -> bool {
        let place = self.ecosystem.places.find(&format!("goals.{name}.goal"));
        let place = place.or_else(|| self.ecosystem.places.find(&format!("goals.{name}")));
        place.is_some_and(|(source, place, _)| {
            source.text.get(place.value.range()).is_some_and(|text| text.contains(goal.trim()))
        })
    }

    fn say_of_goal(&mut self, name: &str, goal: &str, found: Diagnostic) {
        let path = format!("goals.{name}.goal");
        match self.ecosystem.places.find(&path) {
            Some((source, place, true)) => {
                let found = moved_goal(found, &source, place, goal);
                self.report.add(&source, [found]);
            }
            _ => self.report_value(&path, found),
        }
    }

    /// Returns the names of the agents without a known action model: agents of interfaces and
    /// packages, and agents that cannot be built.
    pub(super) fn agents(&self, models: &BTreeMap<AgentId, ActionModel>) -> BTreeSet<String> {
        let own = self.ecosystem.agents.iter().map(|entry| entry.name.to_string());
        let own = own.chain(self.ecosystem.places.names_of_agents());
        let rules = self.ecosystem.interfaces.iter().flat_map(|interface| &interface.imports);
        let borrowed = rules.map(|rule| rule.proxy_name.to_string());
        own.chain(borrowed).filter(|name| !models.keys().any(|id| id.as_str() == name)).collect()
    }

    /// Turns the error that a word is unknown into a warning if the word resembles no known word,
    /// because an agent that joins later may declare it. Returns `None` if some entries of the file
    /// could not be understood, because one of these may declare the word.
    pub(super) fn softened(&self, mut found: Diagnostic) -> Option<Diagnostic> {
        if let Some(variable) = found.message.strip_prefix("unknown variable `") {
            let variable = variable.trim_end_matches('`');
            found.help = Some(format!(
                "name an object, or write (forall ({variable} - room) …) around it for all rooms"
            ));
            return Some(found);
        }
        if found.message.starts_with("unknown ") && found.help.is_none() {
            found.severity = Severity::Warning;
            let help = "neither the map nor an agent of this file brings it; the goal waits for an \
                        agent that does";
            found.help = Some(help.to_owned());
            return self.is_complete.then_some(found);
        }
        Some(found)
    }
}

/// Returns a diagnostic with the explanation that the predicate stands first, if another word of the
/// atom is the predicate: `(robot at hall)`.
fn in_order(found: &Diagnostic, domain: &Domain, goal: &Condition) -> Option<Diagnostic> {
    let word = found.message.strip_prefix("unknown predicate `")?.strip_suffix('`')?;
    let is_predicate = |name: &str| domain.predicates.iter().any(|it| it.name.as_str() == name);
    let atom = atom_named(goal, word)?;
    let mut words: Vec<&str> = atom.arguments.iter().map(|term| term.name().as_str()).collect();
    let at = words.iter().position(|word| is_predicate(word))?;
    let predicate = words.remove(at);
    words.insert(0, word);
    let help = format!("the predicate stands first: write ({predicate} {})", words.join(" "));
    Some(found.clone().with_help(help))
}

/// Explains that a word is an action, if an agent has one of this name.
pub(super) fn explained_action(
    found: Diagnostic,
    models: &BTreeMap<AgentId, ActionModel>,
) -> Diagnostic {
    let word = found.message.strip_prefix("unknown predicate `");
    let Some(word) = word.and_then(|rest| rest.strip_suffix('`')) else { return found };
    let mut actions =
        models.iter().flat_map(|(id, model)| model.actions.iter().map(move |action| (id, action)));
    let Some((id, action)) = actions.find(|(_, action)| action.name.as_str() == word) else {
        return found;
    };
    let mut help = format!("`{word}` is an action of `{id}`; a goal says what is to be");
    if let Some(effect) = first_added(&action.effect) {
        help += &format!(", such as {effect}");
    }
    Diagnostic { help: Some(help), ..found }
}

/// Returns the first fact that an effect makes true.
fn first_added(effect: &Effect) -> Option<&Atom> {
    match effect {
        Effect::And(all) => all.iter().find_map(first_added),
        Effect::Add(atom) => Some(atom),
        Effect::Forall(_, body) | Effect::When(_, body) => first_added(body),
        Effect::Delete(_) | Effect::Assign(_) => None,
    }
}

/// Returns the first atom of a condition with this predicate.
fn atom_named<'c>(condition: &'c Condition, name: &str) -> Option<&'c Atom> {
    match condition {
        Condition::Atom(atom) => (atom.predicate.as_str() == name).then_some(atom),
        Condition::And(all) | Condition::Or(all) => {
            all.iter().find_map(|each| atom_named(each, name))
        }
        Condition::Not(body) | Condition::Forall(_, body) | Condition::Exists(_, body) => {
            atom_named(body, name)
        }
        Condition::Imply(one, other) => atom_named(one, name).or_else(|| atom_named(other, name)),
        Condition::Equal(..) | Condition::Compare(_) => None,
    }
}

/// Returns a message and a help text about a goal that asks for nothing, or for what can never be.
fn without_content(condition: &Condition) -> Option<(&'static str, &'static str)> {
    match condition {
        Condition::And(all) if all.is_empty() => Some((
            "this goal asks for nothing, so it holds always",
            "name what is to be, such as (known-temperature ROOM)",
        )),
        Condition::Or(any) if any.is_empty() => Some((
            "no alternative stands in this goal, so it can never hold",
            "write the alternatives: (or (at ROBOT ROOM) (at ROBOT OTHER-ROOM))",
        )),
        _ => None,
    }
}

/// Adds an example with objects of the map to an error about the number of arguments.
fn with_example(mut found: Diagnostic, map: &Problem) -> Diagnostic {
    let is_count = found.message.contains(" takes ") && found.message.contains("argument");
    let (None, Some(rule), true) = (&found.help, found.rule.as_deref(), is_count) else {
        return found;
    };
    let Ok(declared) = pddl::parse_condition(&plain_rule(rule, map)).into_result() else {
        return found;
    };
    found.help = Some(format!("write for example {declared}"));
    found
}

/// Returns the declaration `(NAME ?x - TYPE …)` with an object of the map in the place of each
/// parameter; a parameter for which the map has none stays.
fn plain_rule(rule: &str, map: &Problem) -> String {
    let inner = rule.trim_matches(['(', ')']);
    let mut parts = inner.split_whitespace();
    let name = parts.next().unwrap_or_default();
    let words: Vec<&str> = parts.collect();
    let mut arguments = Vec::new();
    for (at, word) in words.iter().enumerate().filter(|(_, word)| word.starts_with('?')) {
        let rest = &words[at..];
        let ty = rest.iter().position(|word| *word == "-").and_then(|dash| rest.get(dash + 1));
        let objects = map.objects.iter().map(|declaration| &declaration.object);
        let is_one = |object: &&pddl::Typed| {
            let ty = ty.copied().unwrap_or("object");
            ty == "object" || object.ty.alternatives.iter().any(|own| own.as_str() == ty)
        };
        let example = objects.into_iter().find(is_one);
        arguments.push(example.map_or(*word, |object| object.name.as_str()).to_owned());
    }
    format!("({name} {})", arguments.join(" "))
}

/// Returns the ontology and the map, each extended from the action models: the ontology by types,
/// predicates and functions, the map by objects.
fn widened<'m>(
    ontology: &Arc<Domain>,
    map: &Arc<Problem>,
    models: impl Iterator<Item = &'m ActionModel>,
) -> (Domain, Problem) {
    let (mut domain, problem) = (Domain::clone(ontology), Problem::clone(map));
    let mut objects = Vec::clone(&problem.objects);
    for model in models {
        for ty in &model.types {
            if !domain.types.iter().any(|known| known.name == ty.name) {
                domain.types.push(ty.clone());
            }
        }
        for predicate in &model.predicates {
            if !domain.predicates.iter().any(|known| known.name == predicate.name) {
                domain.predicates.push(predicate.clone());
            }
        }
        for function in &model.functions {
            if !domain.functions.iter().any(|known| known.name == function.name) {
                domain.functions.push(function.clone());
            }
        }
        for declaration in &model.objects {
            let name = &declaration.object.name;
            let is_known =
                objects.iter().any(|known: &ObjectDeclaration| known.object.name == *name);
            if !is_known && !domain.constants.iter().any(|known| known.name == *name) {
                objects.push(declaration.clone());
            }
        }
    }
    (domain, Problem { objects: Arc::new(objects), ..problem })
}
