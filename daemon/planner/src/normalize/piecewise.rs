//! Wide actions applied piece by piece: one parameter is chosen after the other, then all happens.
//!
//! An action of thirty parameters has more ground forms than memory has room for, though few of them
//! can be applied in any one state. Here each parameter becomes an action of its own, which holds what
//! of the precondition speaks of it and of those chosen before; a last one has the effects, each under
//! the condition that its objects are those chosen. Between them nothing else happens, so that the
//! plans are those of before, with more steps (after Areces, Bustos, Dominguez and Hoffmann, 2014,
//! “Optimizing Planning Domains by Automatic Action Schema Splitting”, whose pieces share the effects,
//! too).
//!
//! What is lost is guidance: the relaxation of a choice knows little of the choices before it. So this
//! is for tasks that do not ground otherwise.

use pddl::{Name, Plan, PlanStep};
use rustc_hash::FxHashMap;

use super::lifted::{
    Formula, Lifted, LiftedAtom, LiftedEffect, LiftedNumeric, LiftedTerm, PredicateIndex,
    PredicateUse, Schema, Slot,
};
use super::wide::{renumber, scope};

/// Parameters from which on an action is expected to have too many ground forms.
const WIDE: usize = 8;

/// Parameters of actions that stay whole. Few, as chosen objects are more loosely related than
/// parameters are: more facts seem reachable, and whoever joins four of them joins too many.
const WHOLE_MAX: usize = 3;

/// Parameters that one piece speaks of, where it need not speak of more.
const PIECE_MAX: usize = 2;

/// A lifted task whose wide actions are applied piece by piece.
#[derive(Debug)]
pub(crate) struct Piecewise {
    pub(crate) lifted: Lifted,
    /// By the names of the pieces, which no text can have.
    roles: FxHashMap<Name, Role>,
}

/// What a piece of an action does.
#[derive(Clone, Debug)]
enum Role {
    /// Chooses a parameter: its first argument.
    Chooses(usize),
    /// Tests or costs.
    Tests,
    /// Has the effects of the action of that name.
    Applies(Name),
}

/// Some of the precondition of an action, in terms of its own frame.
#[derive(Debug, Default)]
struct Piece {
    chooses: Option<Slot>,
    /// The parameters it speaks of, the one that it chooses first.
    scope: Vec<Slot>,
    tests: Vec<Formula>,
    costs: Vec<LiftedNumeric>,
}

/// Whether some action is so wide that its task may not ground, and can be taken apart.
pub(crate) fn is_wide(lifted: &Lifted) -> bool {
    let is_one = |schema: &Schema| schema.parameter_count >= WIDE && comes_apart(lifted, schema);
    lifted.schemas.iter().any(is_one)
}

/// Whether an action can be taken apart: what it changes of numbers is cost alone, which does not
/// matter to the pieces that follow.
fn comes_apart(lifted: &Lifted, schema: &Schema) -> bool {
    schema.numeric.iter().all(|change| {
        !lifted.functions[change.fluent.function].read
            && change.variables.is_empty()
            && change.condition.is_true()
    })
}

// === impl Piecewise ===

impl Piecewise {
    /// Takes all actions apart that have more than a few parameters.
    pub(crate) fn new(lifted: &Lifted) -> Piecewise {
        Piecewise::above(lifted, WHOLE_MAX)
    }

    /// The same, of actions with more parameters than that.
    fn above(lifted: &Lifted, whole_max: usize) -> Piecewise {
        let mut whole = lifted.clone();
        let schemas = std::mem::take(&mut whole.schemas);
        if whole.costs.weights.is_none() {
            // Every action costs one, and not every piece.
            whole.costs.weights = Some(Vec::new());
            whole.costs.per_step = 1.0;
        }
        let mut taker = Taker { idle: 0, made: whole, roles: FxHashMap::default() };
        taker.idle = taker.predicate("idle ", 0);
        for schema in schemas {
            if schema.parameter_count > whole_max && comes_apart(lifted, &schema) {
                taker.take_apart(&schema);
            } else {
                taker.keep(schema);
            }
        }
        let Taker { idle, mut made, roles } = taker;
        made.init.push((idle, Vec::new()));
        let goal = std::mem::take(&mut made.goal.formula);
        made.goal.formula = Formula::And(vec![goal, holds(idle, &[])]);
        Piecewise { lifted: made, roles }
    }

    /// A plan in the actions of the text.
    pub(crate) fn whole(&self, plan: Plan) -> Plan {
        let mut chosen: Vec<Option<Name>> = Vec::new();
        let mut steps = Vec::new();
        for step in plan.steps {
            match self.roles.get(&step.action) {
                None => steps.push(step),
                Some(Role::Tests) => (),
                Some(Role::Chooses(parameter)) => {
                    chosen.resize(chosen.len().max(parameter + 1), None);
                    chosen[*parameter] = step.arguments.into_iter().next();
                }
                Some(Role::Applies(name)) => {
                    let arguments: Vec<Name> = chosen.drain(..).flatten().collect();
                    steps.push(PlanStep::new(name.clone(), arguments));
                }
            }
        }
        Plan { steps, ..plan }
    }
}

/// What is made of the actions.
struct Taker {
    /// Says that no action has begun.
    idle: PredicateIndex,
    made: Lifted,
    roles: FxHashMap<Name, Role>,
}

// === impl Taker ===

impl Taker {
    /// A predicate of our own, which actions add and delete.
    fn predicate(&mut self, name: &str, arity: usize) -> PredicateIndex {
        let name = Name::new(name);
        let (added, deleted, derived) = (true, true, false);
        self.made.predicates.push(PredicateUse { name, arity, added, deleted, derived });
        self.made.predicates.len() - 1
    }

    /// Whole, but not while another has begun.
    fn keep(&mut self, mut schema: Schema) {
        let precondition = std::mem::take(&mut schema.precondition);
        schema.precondition = Formula::And(vec![holds(self.idle, &[]), precondition]);
        self.made.schemas.push(schema);
    }

    fn take_apart(&mut self, schema: &Schema) {
        let name = schema.name.as_str();
        // By parameter: whether an object is the one that was chosen.
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

    /// One piece, from a stage to the next.
    fn piece(
        &mut self,
        schema: &Schema,
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
        let mut role = Role::Tests;
        if let Some(slot) = chooses {
            effects.push(happens(true, chosen[slot as usize], &[0]));
            role = Role::Chooses(slot as usize);
        }
        // No name of a text has a space.
        let name = Name::new(&format!("{} {number}", schema.name));
        self.roles.insert(name.clone(), role);
        self.made.schemas.push(Schema {
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

    /// The last piece: without parameters, as they are chosen.
    fn last(&mut self, schema: &Schema, chosen: &[PredicateIndex], stage: PredicateIndex) {
        let is_parameter = |slot: &Slot| (*slot as usize) < schema.parameter_count;
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
            let slot = slot as Slot;
            effects.push(LiftedEffect { variables: vec![slot], ..happens(false, *token, &[slot]) });
        }
        effects.extend([happens(false, stage, &[]), happens(true, self.idle, &[])]);
        let name = Name::new(&format!("{} at last", schema.name));
        self.roles.insert(name.clone(), Role::Applies(schema.name.clone()));
        self.made.schemas.push(Schema {
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

/// In which order parameters are chosen, and what is tested when: first those of which the
/// precondition says most in terms of what is chosen already, as a join would take them.
fn pieces(schema: &Schema, chosen: &[PredicateIndex]) -> Vec<Piece> {
    let mut open = Vec::new();
    conjuncts(&schema.precondition, &mut open);
    let mut bound: Vec<Slot> = Vec::new();
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
            // That another was chosen says as much without a further parameter.
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

/// The parameter that is chosen next.
fn next(schema: &Schema, bound: &[Slot], open: &[Formula]) -> Slot {
    let parameters = (0..schema.parameter_count as Slot).filter(|slot| !bound.contains(slot));
    let atoms = || {
        open.iter()
            .filter(|part| matches!(part, Formula::Literal { positive: true, .. }))
            .map(Formula::free_slots)
    };
    let worth = |slot: &Slot| {
        let speaks = |scope: &Vec<Slot>| scope.contains(slot);
        let is_joined =
            |scope: &Vec<Slot>| scope.iter().all(|one| one == slot || bound.contains(one));
        let joined = atoms().filter(speaks).filter(is_joined).count();
        (joined, atoms().filter(speaks).count())
    };
    // Of those that are worth the same, the first of the text.
    parameters.rev().max_by_key(worth).unwrap_or_default()
}

// === impl Piece ===

impl Piece {
    /// Whether a test fits, without a parameter too many.
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

fn extend(scope: &mut Vec<Slot>, test: &Formula) {
    for slot in test.free_slots() {
        if !scope.contains(&slot) {
            scope.push(slot);
        }
    }
}

/// What must hold together.
fn conjuncts(formula: &Formula, parts: &mut Vec<Formula>) {
    match formula {
        Formula::And(all) => all.iter().for_each(|part| conjuncts(part, parts)),
        Formula::Constant(true) => (),
        other => parts.push(other.clone()),
    }
}

/// The two variables that a formula says are different.
fn unequal(part: &Formula) -> Option<(Slot, Slot)> {
    match part {
        Formula::Equal {
            positive: false,
            left: LiftedTerm::Variable(left),
            right: LiftedTerm::Variable(right),
        } if left != right => Some((*left, *right)),
        _ => None,
    }
}

/// From which other variable this one must differ.
fn unequal_to(part: &Formula, slot: Slot) -> Option<Slot> {
    let (left, right) = unequal(part)?;
    if left == slot { Some(right) } else { Some(left) }
}

fn atom(predicate: PredicateIndex, slots: &[Slot]) -> LiftedAtom {
    LiftedAtom { predicate, arguments: slots.iter().copied().map(LiftedTerm::Variable).collect() }
}

fn holds(predicate: PredicateIndex, slots: &[Slot]) -> Formula {
    Formula::Literal { positive: true, atom: atom(predicate, slots) }
}

fn not(literal: Formula) -> Formula {
    match literal {
        Formula::Literal { positive, atom } => Formula::Literal { positive: !positive, atom },
        other => other,
    }
}

fn happens(adds: bool, predicate: PredicateIndex, slots: &[Slot]) -> LiftedEffect {
    let (variables, condition) = (Vec::new(), Formula::default());
    LiftedEffect { variables, condition, adds, atom: atom(predicate, slots) }
}

/// Gives a variable the number of its place in `slots`.
fn renumber_term(term: &mut LiftedTerm, slots: &[Slot]) {
    if let LiftedTerm::Variable(slot) = term
        && let Some(place) = slots.iter().position(|one| one == slot)
    {
        *slot = place as Slot;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::small_tasks::{cheapest, lifted, parsed};
    use crate::validate::{Verdict, validate};

    const PREDICATES: &str =
        "(:predicates (p ?x - t) (q ?x - t) (r ?x ?y - t) (link ?x ?y - t) (won))";

    /// A part of the precondition of an action with the parameters ?a to ?d.
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

    /// An effect of it; what is deleted and added at once is there afterwards.
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
        fn plans_are_those_of_the_whole(
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

    /// Rings of atoms, as chemists know them: as many ground forms as there are ways round.
    #[test]
    fn what_is_wide_and_what_can_be_taken_apart() {
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
        // Numbers that conditions read change between the pieces.
        let numeric = task("?a ?b ?c ?d ?e ?f ?g ?h", "(decrease (left) 1)");
        assert!(!is_wide(&numeric));
        assert_eq!(Piecewise::new(&numeric).lifted.schemas.len(), 1, "it stays whole");
    }
}
