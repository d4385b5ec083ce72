//! Piecewise application of wide actions: the parameters are chosen one after the other, and then
//! the effects occur.
//!
//! An action with thirty parameters has more ground instances than fit into memory, although few of
//! them are applicable in any one state. Here each parameter becomes an action of its own, which
//! tests the part of the precondition about this parameter and those chosen before. A last action
//! has the effects, each under the condition that its objects are the chosen ones. No other action
//! is applicable between the pieces, so the plans are the same as before, with more steps. (The
//! method follows Areces, Bustos, Dominguez and Hoffmann, 2014, “Optimizing Planning Domains by
//! Automatic Action Schema Splitting”, where the effects are also split.)
//!
//! The drawback is weaker guidance, because the relaxation loses the connection between choices.
//! This method is therefore used only for tasks that cannot be grounded otherwise.

use pddl::{Name, Plan, PlanStep};
use rustc_hash::FxHashMap;

use super::lifted::{
    Formula, Lifted, LiftedAtom, LiftedEffect, LiftedNumeric, LiftedSchema, LiftedTerm,
    PredicateIndex, PredicateUse, SlotIndex,
};
use super::wide::{renumber, scope};

/// Number of parameters from which an action is expected to have too many ground instances.
const WIDE: usize = 8;

/// Maximum number of parameters of an action that is kept whole; an action with more is split. The
/// limit is small because the relaxation loses relations between chosen objects. More facts are
/// therefore relaxed reachable, and joins of four variables over them are too large.
const WHOLE_MAX: usize = 3;

/// Maximum number of parameters in one piece. A single conjunct of the precondition with more
/// parameters has a larger piece of its own.
const PIECE_MAX: usize = 2;

/// A lifted task with its wide actions split into pieces.
#[derive(Debug)]
pub(crate) struct Piecewise {
    pub(crate) lifted: Lifted,
    /// Role of each piece, by the name of the piece. These names contain spaces, so they differ
    /// from all names in a text.
    roles: FxHashMap<Name, PieceRole>,
}

/// Role of a piece of an action.
#[derive(Clone, Debug)]
enum PieceRole {
    /// The piece chooses the object of this parameter, which is the first argument of the piece.
    Chooses(usize),
    /// The piece only tests conditions or adds cost.
    Tests,
    /// The piece has the effects of the action with this name.
    Applies(Name),
}

/// A part of an action's precondition over the frame of the action, with the parameters in it.
#[derive(Debug, Default)]
struct Piece {
    chooses: Option<SlotIndex>,
    /// Parameters in the piece. A parameter that the piece chooses comes first.
    scope: Vec<SlotIndex>,
    tests: Vec<Formula>,
    costs: Vec<LiftedNumeric>,
}

/// Whether the task contains an action that can be split and has so many parameters that grounding
/// may fail.
pub(crate) fn is_wide(lifted: &Lifted) -> bool {
    let is_one =
        |schema: &LiftedSchema| schema.parameter_count >= WIDE && can_be_split(lifted, schema);
    lifted.schemas.iter().any(is_one)
}

/// Whether an action can be split: its only numeric effects are costs, which do not affect later
/// pieces.
fn can_be_split(lifted: &Lifted, schema: &LiftedSchema) -> bool {
    schema.numeric.iter().all(|change| {
        !lifted.functions[change.fluent.function].read
            && change.variables.is_empty()
            && change.condition.is_true()
    })
}

// === impl Piecewise ===

impl Piecewise {
    /// Splits all actions with more than [`WHOLE_MAX`] parameters.
    pub(crate) fn new(lifted: &Lifted) -> Piecewise {
        Piecewise::above(lifted, WHOLE_MAX)
    }

    /// Does the same as [`Piecewise::new`] for actions with more than `whole_max` parameters.
    fn above(lifted: &Lifted, whole_max: usize) -> Piecewise {
        let mut whole = lifted.clone();
        let schemas = std::mem::take(&mut whole.schemas);
        if whole.costs.weights.is_none() {
            // Every action costs one, but only one of its pieces has this cost.
            whole.costs.weights = Some(Vec::new());
            whole.costs.per_step = 1.0;
        }
        let mut taker = ActionSplitter { idle: 0, made: whole, roles: FxHashMap::default() };
        taker.idle = taker.predicate("idle ", 0);
        for schema in schemas {
            if schema.parameter_count > whole_max && can_be_split(lifted, &schema) {
                taker.split_action(&schema);
            } else {
                taker.keep(schema);
            }
        }
        let ActionSplitter { idle, mut made, roles } = taker;
        made.init.push((idle, Vec::new()));
        let goal = std::mem::take(&mut made.goal.formula);
        made.goal.formula = Formula::And(vec![goal, holds(idle, &[])]);
        Piecewise { lifted: made, roles }
    }

    /// Translates a plan of pieces to a plan of the actions in the text.
    pub(crate) fn whole(&self, plan: Plan) -> Plan {
        let mut chosen: Vec<Option<Name>> = Vec::new();
        let mut steps = Vec::new();
        for step in plan.steps {
            match self.roles.get(&step.action) {
                None => steps.push(step),
                Some(PieceRole::Tests) => (),
                Some(PieceRole::Chooses(parameter)) => {
                    chosen.resize(chosen.len().max(parameter + 1), None);
                    chosen[*parameter] = step.arguments.into_iter().next();
                }
                Some(PieceRole::Applies(name)) => {
                    let arguments: Vec<Name> = chosen.drain(..).flatten().collect();
                    steps.push(PlanStep::new(name.clone(), arguments));
                }
            }
        }
        Plan { steps, ..plan }
    }
}

/// State of the splitting of all actions of a task.
struct ActionSplitter {
    /// Predicate of the fact that no action is in progress.
    idle: PredicateIndex,
    made: Lifted,
    roles: FxHashMap<Name, PieceRole>,
}

// === impl ActionSplitter ===

impl ActionSplitter {
    /// Adds an auxiliary predicate, with facts that only pieces add and delete.
    fn predicate(&mut self, name: &str, arity: usize) -> PredicateIndex {
        let name = Name::new(name);
        let (added, deleted, derived) = (true, true, false);
        self.made.predicates.push(PredicateUse { name, arity, added, deleted, derived });
        self.made.predicates.len() - 1
    }

    /// Adds an action without splitting it. The action is applicable only while no other action is
    /// in progress.
    fn keep(&mut self, mut schema: LiftedSchema) {
        let precondition = std::mem::take(&mut schema.precondition);
        schema.precondition = Formula::And(vec![holds(self.idle, &[]), precondition]);
        self.made.schemas.push(schema);
    }

    fn split_action(&mut self, schema: &LiftedSchema) {
        let name = schema.name.as_str();
        // Per parameter: a predicate that is true for the chosen object.
        let chosen: Vec<PredicateIndex> = (0..schema.parameter_count)
            .map(|parameter| self.predicate(&format!("{name} chosen {parameter}"), 1))
            .collect();
        let mut stage = self.idle;
        for (number, piece) in pieces(schema, &chosen).into_iter().enumerate() {
            let next = self.predicate(&format!("{name} after {number}"), 0);
            self.piece(schema, number, piece, &chosen, (stage, next));
            stage = next;
        }
        self.last(schema, &chosen, stage);
    }

    /// Adds one piece of an action. The piece leads from one stage of the action to the next.
    fn piece(
        &mut self,
        schema: &LiftedSchema,
        number: usize,
        piece: Piece,
        chosen: &[PredicateIndex],
        (stage, next): (PredicateIndex, PredicateIndex),
    ) {
        let Piece { chooses, scope: mut slots, tests, mut costs } = piece;
        let parameter_count = slots.len();
        let before = slots.iter().filter(|slot| Some(**slot) != chooses);
        let mut parts = vec![holds(stage, &[])];
        parts.extend(before.map(|slot| holds(chosen[*slot as usize], &[*slot])));
        parts.extend(tests);
        let mut precondition = Formula::And(parts);
        renumber(&mut precondition, &mut slots);
        for change in &mut costs {
            let mut place = |term: &mut LiftedTerm| renumber_term(term, &slots);
            change.fluent.arguments.iter_mut().for_each(&mut place);
            change.value.terms_mut(&mut place);
        }
        let mut effects = vec![happens(false, stage, &[]), happens(true, next, &[])];
        let mut role = PieceRole::Tests;
        if let Some(slot) = chooses {
            effects.push(happens(true, chosen[slot as usize], &[0]));
            role = PieceRole::Chooses(slot as usize);
        }
        // Names in a text contain no spaces, so this name is unique.
        let name = Name::new(&format!("{} {number}", schema.name));
        self.roles.insert(name.clone(), role);
        self.made.schemas.push(LiftedSchema {
            name,
            piece_of: Some(schema.name.clone()),
            parameter_count,
            frame: slots.iter().map(|slot| schema.frame[*slot as usize]).collect(),
            precondition,
            effects,
            numeric: costs,
            span: schema.span,
        });
    }

    /// Adds the last piece of an action, which has the effects. This piece has no parameters,
    /// because all objects are already chosen.
    fn last(&mut self, schema: &LiftedSchema, chosen: &[PredicateIndex], stage: PredicateIndex) {
        let is_parameter = |slot: &SlotIndex| (*slot as usize) < schema.parameter_count;
        let mut effects: Vec<LiftedEffect> = Vec::new();
        for effect in &schema.effects {
            let atom = Formula::Literal { positive: true, atom: effect.atom.clone() };
            let mut objects = scope([&atom, &effect.condition].into_iter());
            objects.retain(is_parameter);
            let mut parts: Vec<Formula> =
                objects.iter().map(|slot| holds(chosen[*slot as usize], &[*slot])).collect();
            if !effect.condition.is_true() {
                parts.push(effect.condition.clone());
            }
            let variables = objects.into_iter().chain(effect.variables.iter().copied()).collect();
            effects.push(LiftedEffect {
                variables,
                condition: Formula::And(parts),
                ..effect.clone()
            });
        }
        for (slot, token) in chosen.iter().enumerate() {
            let slot = slot as SlotIndex;
            effects.push(LiftedEffect { variables: vec![slot], ..happens(false, *token, &[slot]) });
        }
        effects.extend([happens(false, stage, &[]), happens(true, self.idle, &[])]);
        let name = Name::new(&format!("{} at last", schema.name));
        self.roles.insert(name.clone(), PieceRole::Applies(schema.name.clone()));
        self.made.schemas.push(LiftedSchema {
            name,
            piece_of: None,
            parameter_count: 0,
            frame: schema.frame.clone(),
            precondition: holds(stage, &[]),
            effects,
            numeric: Vec::new(),
            span: schema.span,
        });
    }
}

/// Determines the order of choosing parameters and testing conditions. As in a join, the parameter
/// with the most conditions over already chosen parameters comes first.
fn pieces(schema: &LiftedSchema, chosen: &[PredicateIndex]) -> Vec<Piece> {
    let mut open = Vec::new();
    conjuncts(&schema.precondition, &mut open);
    let mut bound: Vec<SlotIndex> = Vec::new();
    let mut pieces = Vec::new();
    while bound.len() < schema.parameter_count {
        let slot = next(schema, &bound, &open);
        bound.push(slot);
        let is_known = |part: &Formula| part.free_slots().iter().all(|one| bound.contains(one));
        let (due, later): (Vec<_>, Vec<_>) = open.into_iter().partition(is_known);
        open = later;
        let mut piece = Piece { chooses: Some(slot), scope: vec![slot], ..Piece::default() };
        let mut others: Vec<Piece> = Vec::new();
        let (different, due): (Vec<_>, Vec<_>) =
            due.into_iter().partition(|part| unequal(part).is_some());
        for part in due {
            let wider = others.last_mut().into_iter();
            let room = std::iter::once(&mut piece).chain(wider).find(|one| one.has_room_for(&part));
            match room {
                Some(room) => room.push(part),
                None => {
                    let mut other = Piece::default();
                    other.push(part);
                    others.push(other);
                }
            }
        }
        for part in different {
            let other = unequal_to(&part, slot).filter(|other| !piece.scope.contains(other));
            // A test that the object was chosen for the other parameter needs no additional
            // parameter.
            let test = other.map(|other| not(holds(chosen[other as usize], &[slot])));
            piece.tests.push(test.unwrap_or(part));
        }
        pieces.push(piece);
        pieces.extend(others);
    }
    if !schema.numeric.is_empty() {
        let mut costs = Piece { costs: schema.numeric.clone(), ..Piece::default() };
        for change in &schema.numeric {
            let mut term = |term: &LiftedTerm| {
                if let LiftedTerm::Variable(slot) = term
                    && !costs.scope.contains(slot)
                {
                    costs.scope.push(*slot);
                }
            };
            change.fluent.arguments.iter().for_each(&mut term);
            change.value.terms(&mut term);
        }
        pieces.push(costs);
    }
    pieces
}

/// Returns the parameter to choose next. `bound` are the chosen parameters, and `open` the
/// conditions that are not tested yet.
fn next(schema: &LiftedSchema, bound: &[SlotIndex], open: &[Formula]) -> SlotIndex {
    let parameters = (0..schema.parameter_count as SlotIndex).filter(|slot| !bound.contains(slot));
    let atoms = || {
        open.iter()
            .filter(|part| matches!(part, Formula::Literal { positive: true, .. }))
            .map(Formula::free_slots)
    };
    let worth = |slot: &SlotIndex| {
        let speaks = |scope: &Vec<SlotIndex>| scope.contains(slot);
        let is_joined =
            |scope: &Vec<SlotIndex>| scope.iter().all(|one| one == slot || bound.contains(one));
        let joined = atoms().filter(speaks).filter(is_joined).count();
        (joined, atoms().filter(speaks).count())
    };
    // Of equally good parameters, the first in the text is chosen.
    parameters.rev().max_by_key(worth).unwrap_or_default()
}

// === impl Piece ===

impl Piece {
    /// Whether a conjunct of the precondition fits into this piece within the limit on parameters.
    fn has_room_for(&self, test: &Formula) -> bool {
        let mut scope = self.scope.clone();
        extend(&mut scope, test);
        scope.len() <= PIECE_MAX.max(self.scope.len())
    }

    fn push(&mut self, test: Formula) {
        extend(&mut self.scope, &test);
        self.tests.push(test);
    }
}

fn extend(scope: &mut Vec<SlotIndex>, test: &Formula) {
    for slot in test.free_slots() {
        if !scope.contains(&slot) {
            scope.push(slot);
        }
    }
}

/// Collects the conjuncts of a formula.
fn conjuncts(formula: &Formula, parts: &mut Vec<Formula>) {
    match formula {
        Formula::And(all) => all.iter().for_each(|part| conjuncts(part, parts)),
        Formula::Constant(true) => (),
        other => parts.push(other.clone()),
    }
}

/// Returns the two variables that a formula requires to be different; `None` for any other formula.
fn unequal(part: &Formula) -> Option<(SlotIndex, SlotIndex)> {
    match part {
        Formula::Equal {
            positive: false,
            left: LiftedTerm::Variable(left),
            right: LiftedTerm::Variable(right),
        } if left != right => Some((*left, *right)),
        _ => None,
    }
}

/// Returns the variable that `part` requires to differ from `slot`; `None` if `part` is not such a
/// requirement.
fn unequal_to(part: &Formula, slot: SlotIndex) -> Option<SlotIndex> {
    let (left, right) = unequal(part)?;
    if left == slot { Some(right) } else { Some(left) }
}

fn atom(predicate: PredicateIndex, slots: &[SlotIndex]) -> LiftedAtom {
    LiftedAtom { predicate, arguments: slots.iter().copied().map(LiftedTerm::Variable).collect() }
}

fn holds(predicate: PredicateIndex, slots: &[SlotIndex]) -> Formula {
    Formula::Literal { positive: true, atom: atom(predicate, slots) }
}

fn not(literal: Formula) -> Formula {
    match literal {
        Formula::Literal { positive, atom } => Formula::Literal { positive: !positive, atom },
        other => other,
    }
}

fn happens(adds: bool, predicate: PredicateIndex, slots: &[SlotIndex]) -> LiftedEffect {
    let (variables, condition) = (Vec::new(), Formula::default());
    LiftedEffect { variables, condition, adds, atom: atom(predicate, slots) }
}

/// Replaces a variable in `term` by its position in `slots`.
fn renumber_term(term: &mut LiftedTerm, slots: &[SlotIndex]) {
    if let LiftedTerm::Variable(slot) = term
        && let Some(place) = slots.iter().position(|one| one == slot)
    {
        *slot = place as SlotIndex;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::test_tasks::{cheapest, lifted, parsed};
    use crate::validate::{Verdict, validate};

    const PREDICATES: &str =
        "(:predicates (p ?x - t) (q ?x - t) (r ?x ?y - t) (link ?x ?y - t) (won))";

    /// Generates a part of the precondition of an action with the parameters ?a to ?d.
    fn part() -> impl Strategy<Value = String> {
        prop_oneof![
            4 => (variable(), variable()).prop_map(|(one, two)| format!("(r {one} {two})")),
            3 => (variable(), variable()).prop_map(|(one, two)| format!("(link {one} {two})")),
            2 => variable().prop_map(|one| format!("(p {one})")),
            2 => variable().prop_map(|one| format!("(not (q {one}))")),
            1 => (variable(), variable()).prop_map(|(one, two)| format!("(= {one} {two})")),
            3 => (variable(), variable()).prop_map(|(one, two)| format!("(not (= {one} {two}))")),
            1 => (variable(), variable()).prop_map(|(one, two)| format!("(or (q {one}) (r {one} {two}))")),
            1 => variable().prop_map(|one| format!("(exists (?e - t) (and (r {one} ?e) (p ?e)))")),
            1 => variable().prop_map(|one| format!("(forall (?e - t) (or (link {one} ?e) (p ?e)))")),
            1 => (variable(), variable(), variable())
                .prop_map(|(one, two, three)| format!("(or (r {one} {two}) (link {two} {three}))")),
        ]
    }

    fn variable() -> impl Strategy<Value = &'static str> {
        prop_oneof![Just("?a"), Just("?b"), Just("?c"), Just("?d")]
    }

    /// Generates an effect of the action with the parameters ?a to ?d. A fact that one step both
    /// deletes and adds becomes true.
    fn effect() -> impl Strategy<Value = String> {
        prop_oneof![
            3 => (variable(), variable()).prop_map(|(one, two)| format!("(not (r {one} {two}))")),
            3 => (variable(), variable()).prop_map(|(one, two)| format!("(r {one} {two})")),
            2 => variable().prop_map(|one| format!("(q {one})")),
            1 => variable().prop_map(|one| format!("(not (p {one}))")),
            1 => (variable(), variable()).prop_map(|(one, two)| format!("(when (q {one}) (p {two}))")),
            1 => variable().prop_map(|one| format!("(forall (?e - t) (when (r ?e {one}) (q ?e)))")),
            1 => (variable(), variable())
                .prop_map(|(one, two)| format!("(when (r {one} {two}) (not (r {one} {two})))")),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 300,
            failure_persistence: None,
            rng_seed: proptest::test_runner::RngSeed::Fixed(43),
            ..ProptestConfig::default()
        })]

        #[test]
        fn piecewise_plans_cost_the_same_and_are_valid(
            parts in proptest::collection::vec(part(), 1..5),
            effects in proptest::collection::vec(effect(), 1..5),
            facts in proptest::collection::vec((0..3usize, 0..3usize, 0..4usize), 5..16),
            costs in any::<bool>(),
        ) {
            let (functions, cost, metric) = if costs {
                (
                    "(:functions (total-cost) (far ?x ?y - t))",
                    "(increase (total-cost) (far ?b ?d)) (increase (total-cost) 1)",
                    "(:metric minimize (total-cost))",
                )
            } else {
                ("", "", "")
            };
            let (parts, effects) = (parts.join(" "), effects.join(" "));
            let domain = format!(
                "(define (domain d) (:types t) {PREDICATES} {functions}
                 (:action wide :parameters (?a ?b ?c ?d - t)
                  :precondition (and {parts}) :effect (and {effects} {cost}))
                 (:action narrow :parameters (?a - t) :precondition (q ?a) :effect (p ?a))
                 (:action win :parameters (?a ?b - t)
                  :precondition (and (q ?a) (q ?b) (not (r ?a ?b))) :effect (won)))"
            );
            let names = ["o0", "o1", "o2"];
            let mut init = String::new();
            for (one, two, what) in facts {
                let (one, two) = (names[one], names[two]);
                init += &match what {
                    0 => format!("(p {one})"),
                    1 => format!("(link {one} {two})"),
                    _ => format!("(r {one} {two})"),
                };
            }
            if costs {
                for (one, two) in [(0, 1), (1, 2), (2, 0), (1, 1)] {
                    init += &format!("(= (far {} {}) {})", names[one], names[two], one + two);
                }
            }
            let problem = format!(
                "(define (problem p) (:domain d) (:objects o0 o1 o2 - t)
                 (:init {init}) (:goal (won)) {metric})"
            );
            let whole = lifted(&domain, &problem);
            let piecewise = Piecewise::above(&whole, 0);
            let (expected, found) = (cheapest(&whole), cheapest(&piecewise.lifted));
            let found = found.map(|plan| piecewise.whole(plan));
            let cost = |plan: &Option<Plan>| plan.as_ref().and_then(|plan| plan.cost);
            prop_assert_eq!(cost(&expected), cost(&found), "{}\n{}", domain, problem);
            if let Some(plan) = found {
                let (domain, problem) = parsed(&domain, &problem);
                let verdict = validate(&domain, &problem, &plan);
                let is_valid = matches!(verdict, Verdict::Valid { .. });
                prop_assert!(is_valid, "{:?}: {:?}", plan, verdict);
            }
        }
    }

    /// Checks which actions are wide, and which can be split.
    #[test]
    fn wide_actions_are_split_unless_they_change_compared_numbers() {
        let task = |parameters: &str, effect: &str| {
            let domain = format!(
                "(define (domain d) (:predicates (r ?x ?y) (won)) (:functions (left))
                 (:action turn :parameters ({parameters}) :precondition (> (left) 0)
                  :effect (and (won) {effect})))"
            );
            let problem = "(define (problem p) (:domain d) (:objects o) (:init (= (left) 1))
                (:goal (won)))";
            lifted(&domain, problem)
        };
        assert!(!is_wide(&task("?a ?b ?c ?d ?e ?f ?g", "")));
        assert!(is_wide(&task("?a ?b ?c ?d ?e ?f ?g ?h", "")));
        // Conditions would use numbers that change between the pieces.
        let numeric = task("?a ?b ?c ?d ?e ?f ?g ?h", "(decrease (left) 1)");
        assert!(!is_wide(&numeric));
        assert_eq!(Piecewise::new(&numeric).lifted.schemas.len(), 1, "it stays whole");
    }
}
