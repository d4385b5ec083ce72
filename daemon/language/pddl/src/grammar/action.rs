//! Grammar of actions and axioms.

use super::condition;
use super::declarations;
use super::durative;
use super::effect;
use super::names;
use super::reader::{ExpressionPlace, GrammarReader, Keyword, excerpt};
use crate::diagnostic::Diagnostic;
use crate::sexpr::{Items, SyntaxNode};
use crate::tree::{
    ActionSchema, Atom, Condition, Derived, DurativeAction, Effect, Name, Span, TimedEffect, Typed,
};

const ACTION: &str = "(:action NAME [:agent VARIABLE - TYPE | :agent (VARIABLES)] [:parameters (VARIABLES)] \
    [:precondition CONDITION] [:effect EFFECT] [:observe OBSERVED])";
const OBSERVE: &str = ":observe (SYMBOL TERM*) | (and (SYMBOL TERM*)*)";
const DURATIVE_ACTION: &str = "(:durative-action NAME [:agent VARIABLE - TYPE] \
    [:parameters (VARIABLES)] :duration DURATION [:condition TIMED] [:effect TIMED])";
const DERIVED: &str = "(:derived (PREDICATE VARIABLES) CONDITION)";
const AGENT: &str = ":agent VARIABLE - TYPE";
const AGENTS: &str = ":agent (VARIABLES)";
const PARAMETER_LIST: &str = ":parameters (VARIABLES)";

/// Parses an action: `(:action NAME [:agent VARIABLE - TYPE | :agent (VARIABLES)] [:parameters
/// (VARIABLES)] [:precondition CONDITION] [:effect EFFECT] [:observe OBSERVED])`, with the parts in any order.
pub(super) fn action<'f>(
    reader: &mut GrammarReader<'f>,
    items: Items<'f>,
    span: Span,
) -> Option<ActionSchema> {
    let mut parts = ActionParts::new(reader, items, ACTION)?;
    let mut action = ActionSchema {
        name: parts.name.clone(),
        agent: None,
        partners: Vec::new(),
        parameters: Vec::new(),
        precondition: Condition::always(),
        effect: Effect::nothing(),
        observe: Vec::new(),
        span,
    };
    while let Some((key, node)) = parts.next(reader, &[PRECONDITION, EFFECT, OBSERVE_KEY]) {
        match key {
            AGENT_KEY => (action.agent, action.partners) = parts.agents(reader),
            PARAMETERS => {
                let parameters = parts.parameters(reader, node);
                action.parameters.splice(0..0, parameters).for_each(drop);
            }
            VARS => action.parameters.extend(parts.parameters(reader, node)),
            PRECONDITION => {
                action.precondition = condition::condition(reader, node).unwrap_or_default();
            }
            OBSERVE_KEY => action.observe = observed(reader, node),
            _ => action.effect = effect::effect(reader, node).unwrap_or_default(),
        }
    }
    Some(action)
}

/// Parses a durative action: `(:durative-action NAME [:agent VARIABLE - TYPE] [:parameters
/// (VARIABLES)] :duration DURATION [:condition TIMED] [:effect TIMED])`, with the parts in any
/// order.
pub(super) fn durative_action<'f>(
    reader: &mut GrammarReader<'f>,
    items: Items<'f>,
    span: Span,
) -> Option<DurativeAction> {
    let mut parts = ActionParts::new(reader, items, DURATIVE_ACTION)?;
    let mut action = DurativeAction {
        name: parts.name.clone(),
        agent: None,
        parameters: Vec::new(),
        duration: Vec::new(),
        conditions: Vec::new(),
        effects: TimedEffect::And(Vec::new()),
        span,
    };
    reader.within(ExpressionPlace::Durative, |reader| {
        while let Some((key, node)) = parts.next(reader, &[DURATION, CONDITION, EFFECT]) {
            match key {
                AGENT_KEY => action.agent = parts.opt_agent(reader),
                PARAMETERS => {
                    let parameters = parts.parameters(reader, node);
                    action.parameters.splice(0..0, parameters).for_each(drop);
                }
                VARS => action.parameters.extend(parts.parameters(reader, node)),
                DURATION => action.duration = durative::duration(reader, node),
                CONDITION => action.conditions = durative::conditions(reader, node),
                _ => {
                    action.effects =
                        durative::effect(reader, node).unwrap_or(TimedEffect::And(Vec::new()));
                }
            }
        }
    });
    Some(action)
}

/// Parses an axiom: `(:derived (PREDICATE VARIABLES) CONDITION)`.
pub(super) fn derived<'f>(
    reader: &mut GrammarReader<'f>,
    mut items: Items<'f>,
    span: Span,
) -> Option<Derived> {
    let head = reader.expect(&mut items, "head", DERIVED)?;
    let head = declarations::signature(reader, head, DERIVED);
    let body = reader.expect(&mut items, "condition", DERIVED)?;
    let condition = condition::condition(reader, body);
    reader.expect_end(items, "an axiom", DERIVED);
    let (predicate, parameters) = head?;
    Some(Derived { predicate, parameters, condition: condition?, span })
}

/// Parses the observed symbols of an action: `(SYMBOL TERM*) | (and (SYMBOL TERM*)*)`. A symbol is
/// a predicate or a function.
fn observed<'f>(reader: &mut GrammarReader<'f>, node: SyntaxNode<'f>) -> Vec<Atom> {
    let Some(mut items) = reader.expect_list(node, "what is observed", OBSERVE) else {
        return Vec::new();
    };
    let is_and = |node: SyntaxNode<'_>| {
        node.symbol().is_some_and(|word| Keyword::of(word).as_str() == "and")
    };
    if items.peek().is_some_and(is_and) {
        items.next();
        return items.filter_map(|node| condition::atom(reader, node)).collect();
    }
    condition::atom(reader, node).into_iter().collect()
}

const AGENT_KEY: &str = ":agent";
const PARAMETERS: &str = ":parameters";
/// Key of additional parameters of an action in PDDL 1.2.
const VARS: &str = ":vars";
const PRECONDITION: &str = ":precondition";
const DURATION: &str = ":duration";
const CONDITION: &str = ":condition";
const EFFECT: &str = ":effect";
const OBSERVE_KEY: &str = ":observe";

/// Iterator over the parts of an action: `NAME (KEY VALUE)*`.
struct ActionParts<'f> {
    name: Name,
    items: Items<'f>,
    seen: Vec<(&'static str, Span)>,
    rule: &'static str,
}

impl<'f> ActionParts<'f> {
    fn new(
        reader: &mut GrammarReader<'f>,
        items: Items<'f>,
        rule: &'static str,
    ) -> Option<ActionParts<'f>> {
        let mut items = items;
        let node = reader.expect(&mut items, "name", rule)?;
        let name = names::name(reader, node, "the name of the action")?;
        Some(ActionParts { name, items, seen: Vec::new(), rule })
    }

    /// Returns the next key of an action and the node after it; `None` at the end. The key is one
    /// of `:agent`, `:parameters` and `keys`. Keys that are not expected, and repeated ones, are
    /// reported and skipped.
    fn next(
        &mut self,
        reader: &mut GrammarReader<'f>,
        keys: &[&'static str],
    ) -> Option<(&'static str, SyntaxNode<'f>)> {
        while let Some(node) = self.items.next() {
            let Some(word) = node.symbol().filter(|word| word.starts_with(':')) else {
                // A list that touches the name of the action is not a condition.
                let is_call = !self.seen.is_empty() && reader.is_call(node);
                if !is_call && !reader.is_already_reported(node) {
                    self.report_stranger(reader, node);
                }
                continue;
            };
            let lower = Keyword::of(word);
            let known = [AGENT_KEY, PARAMETERS, VARS].into_iter().chain(keys.iter().copied());
            let key = known.clone().find(|key| *key == lower.as_str());
            if key.is_none() {
                reader.unknown(node, "keyword", &known.collect::<Vec<_>>());
            }
            let Some(value) = self.value(reader, node, word) else { continue };
            if key == Some(VARS) {
                let vars =
                    Diagnostic::warning(node.span(), "`:vars` are read as further parameters");
                reader.report(vars.with_help("write them into `:parameters`"));
            }
            match key {
                Some(key) if self.is_first(reader, key, node.span()) => return Some((key, value)),
                // An agent consists of up to three nodes, which are all skipped.
                Some(AGENT_KEY) => drop(self.agents(reader)),
                _ => {}
            }
        }
        None
    }

    /// Reports a node in the place of a key. After a condition or an effect, the node is probably a
    /// second one, which should be joined with the first by an `and`.
    fn report_stranger(&self, reader: &mut GrammarReader<'f>, node: SyntaxNode<'f>) {
        let after = self.seen.last().map(|(key, _)| *key);
        let what = match after {
            Some(PRECONDITION | CONDITION) => "condition",
            Some(EFFECT) => "effect",
            _ => "",
        };
        let found = excerpt(node);
        reader.report(match (what, after, node.list()) {
            (what @ ("condition" | "effect"), Some(key), Some(_)) => {
                let article = if what == "effect" { "one effect" } else { "one condition" };
                let message = format!("`{key}` is {article}, `{found}` is another");
                Diagnostic::error(node.span(), message).with_help("join them: `(and …)`")
            }
            _ => {
                let message = format!("expected a keyword, found `{found}`");
                Diagnostic::error(node.span(), message).with_rule(self.rule)
            }
        });
    }

    /// Returns the node after a key. After the key `:agent`, the node is not consumed, because
    /// [`ActionParts::agents`] reads it.
    fn value(
        &mut self,
        reader: &mut GrammarReader<'f>,
        key: SyntaxNode<'f>,
        word: &str,
    ) -> Option<SyntaxNode<'f>> {
        match self.items.peek() {
            Some(value) if !value.symbol().is_some_and(|word| word.starts_with(':')) => {
                if !word.eq_ignore_ascii_case(AGENT_KEY) {
                    self.items.next();
                }
                Some(value)
            }
            _ => {
                let message = format!("nothing follows `{word}`");
                reader.report(Diagnostic::error(key.span(), message).with_rule(self.rule));
                None
            }
        }
    }

    fn is_first(&mut self, reader: &mut GrammarReader<'f>, key: &'static str, span: Span) -> bool {
        let Some((_, first)) = self.seen.iter().find(|(seen, _)| *seen == key) else {
            self.seen.push((key, span));
            return true;
        };
        let message = format!("`{key}` is given twice");
        reader.report(Diagnostic::error(span, message).with_note(*first, "the first is here"));
        false
    }

    /// Parses parameters: `(VARIABLES)`. `node` is the first node after the key.
    fn parameters(&mut self, reader: &mut GrammarReader<'f>, node: SyntaxNode<'f>) -> Vec<Typed> {
        let is_key = |node: SyntaxNode<'_>| node.symbol().is_some_and(|word| word.starts_with(':'));
        names::listed_variables(reader, node, &mut self.items, is_key, PARAMETER_LIST)
    }

    /// Parses the agents of an action: `VARIABLE [- TYPE]` or `(VARIABLES)`. Returns the first one
    /// and the others.
    fn agents(&mut self, reader: &mut GrammarReader<'f>) -> (Option<Typed>, Vec<Typed>) {
        let Some(node) = self.items.peek() else { return (None, Vec::new()) };
        let is_key = |node: SyntaxNode<'_>| node.symbol().is_some_and(|word| word.starts_with(':'));
        let is_variable =
            |node: &SyntaxNode<'_>| node.symbol().is_some_and(|it| it.starts_with('?'));
        let are_several = || self.items.until(is_key).filter(is_variable).count() > 1;
        let mut agents = match node.list() {
            Some(inner) => {
                self.items.next();
                names::variables(reader, inner)
            }
            None if is_variable(&node) && are_several() => {
                self.items.next();
                names::listed_variables(reader, node, &mut self.items, is_key, AGENTS)
            }
            None => {
                return (declarations::opt_typed_variable(reader, &mut self.items), Vec::new());
            }
        };
        if agents.is_empty() {
            let message = "`:agent` names no variable";
            reader.report(Diagnostic::error(node.span(), message).with_rule(AGENTS));
            return (None, Vec::new());
        }
        (Some(agents.remove(0)), agents)
    }

    /// Parses the agent of a durative action, which has one at most.
    fn opt_agent(&mut self, reader: &mut GrammarReader<'f>) -> Option<Typed> {
        let (agent, partners) = self.agents(reader);
        if let Some(partner) = partners.first() {
            let message = "a durative action has one agent";
            reader.report(Diagnostic::error(partner.name.span(), message).with_rule(AGENT));
        }
        agent
    }
}
