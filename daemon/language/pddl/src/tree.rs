//! The syntax tree: the content of a PDDL text, before its meaning is checked.
//!
//! - The parser builds the tree, the printer prints it, and `check`, `capability` and `planner`
//!   read it.
//! - The tree is *lifted*: parameters are variables. `planner` creates ground actions.
//! - Two trees are equal if they have the same content. Spans and the author's spelling are not
//!   compared.

use std::borrow::Borrow;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::sync::Arc;

/// A range of bytes in an author's text, `start..end`.
///
/// All spans are equal in comparisons, so that trees are compared by content and not by place.
#[derive(Clone, Copy, Debug, Default)]
pub struct Span {
    /// Offset of the first byte.
    pub start: u32,
    /// Offset after the last byte.
    pub end: u32,
}

/// A PDDL symbol. Names are compared without case, and printed as their authors wrote them.
///
/// The names of variables are stored without the question mark.
///
/// A name is cheap to clone, because the parser allocates each spelling once for each text.
#[derive(Clone)]
pub struct Name {
    spelling: Arc<Spelling>,
    span: Span,
}

struct Spelling {
    canonical: Box<str>,
    /// Spelling of the author; `None` if it equals `canonical`.
    spelled: Option<Box<str>>,
}

/// What a domain or a problem without a valid name is called.
const PLACEHOLDER: &str = "unnamed";

/// A type: `TYPE | (either TYPE+)`. The empty list stands for an omitted type, which is `object`.
///
/// `object` alone and the empty list are equal.
#[derive(Clone, Debug, Default)]
pub struct TypeExpr {
    /// The name of the type, or the alternatives of an `either` in the author's order.
    pub alternatives: Vec<Name>,
}

/// A name with a type: a variable, a constant, an object, or a type with its supertype.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Typed {
    /// The name; for a variable, without `?`.
    pub name: Name,
    /// Type of the variable, constant or object; for a type, its supertype.
    pub ty: TypeExpr,
}

/// A variable or an object in argument position.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Term {
    /// The variable `?name`.
    Variable(Name),
    /// The constant or object `name`.
    Object(Name),
}

/// A predicate with its arguments: `(PREDICATE TERM*)`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Atom {
    /// The predicate symbol.
    pub predicate: Name,
    /// The arguments: one term for each parameter of the predicate.
    pub arguments: Vec<Term>,
    /// Place in the text, from `(` to `)`.
    pub span: Span,
}

/// A function with its arguments: `(FUNCTION TERM*)`, or `FUNCTION` alone if it takes no argument.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct FluentTerm {
    /// The function symbol.
    pub function: Name,
    /// The arguments: one term for each parameter of the function.
    pub arguments: Vec<Term>,
    /// Place in the text, from `(` to `)`.
    pub span: Span,
}

/// A finite number. Numbers are equal if their values are, so `1`, `1.0` and `1e0` are one number.
#[derive(Clone, Copy, Debug)]
pub struct Number(pub f64);

/// A condition in an action, an effect, an axiom, or a goal.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Condition {
    /// A predicate with its arguments: `(PREDICATE TERM*)`.
    Atom(Atom),
    /// Equality of two objects: `(= TERM TERM)`.
    Equal(Term, Term, Span),
    /// A comparison of numbers, such as `(< EXPRESSION EXPRESSION)`.
    Compare(Box<Compare>),
    /// A negation: `(not CONDITION)`.
    Not(Box<Condition>),
    /// A conjunction: `(and CONDITION*)`. Without conjuncts it is true. An omitted condition and
    /// `()` are represented in this way.
    And(Vec<Condition>),
    /// A disjunction: `(or CONDITION*)`. Without disjuncts it is false.
    Or(Vec<Condition>),
    /// An implication: `(imply CONDITION CONDITION)`.
    Imply(Box<Condition>, Box<Condition>),
    /// An existential quantifier: `(exists (VARIABLES) CONDITION)`.
    Exists(Vec<Typed>, Box<Condition>),
    /// A universal quantifier: `(forall (VARIABLES) CONDITION)`.
    Forall(Vec<Typed>, Box<Condition>),
}

/// A comparison of numbers: `(COMPARISON EXPRESSION EXPRESSION)`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Compare {
    /// The comparison operator.
    pub comparison: Comparison,
    /// The expression on the left side of the comparison.
    pub left: Expression,
    /// The expression on the right side of the comparison.
    pub right: Expression,
    /// Place in the text, from `(` to `)`.
    pub span: Span,
}

/// The operator of a comparison of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Comparison {
    /// Less than: `<`.
    Less,
    /// Less than or equal: `<=`.
    LessOrEqual,
    /// `=` between two numbers.
    Equal,
    /// Greater than or equal: `>=`.
    GreaterOrEqual,
    /// Greater than: `>`.
    Greater,
}

/// A numeric expression.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Expression {
    /// A number.
    Number(Number),
    /// The value of a function: `(FUNCTION TERM*)`.
    Fluent(FluentTerm),
    /// The negative of a value: `(- EXPRESSION)`.
    Negate(Box<Expression>),
    /// An operator with its operands: `(+ E E+)`, `(- E E)`, `(* E E+)` or `(/ E E)`. `+` and `*`
    /// take two or more operands.
    Apply(Operator, Vec<Expression>),
    /// The duration of a durative action: `?duration`, in its constraints, conditions and effects.
    Duration(Span),
    /// The time since the start of a durative action: `#t`, in a continuous effect.
    ContinuousTime(Span),
    /// The total time of a plan: `total-time`, in a metric.
    TotalTime(Span),
}

/// An arithmetic operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Operator {
    /// Addition: `+`.
    Add,
    /// Subtraction: `-`.
    Subtract,
    /// Multiplication: `*`.
    Multiply,
    /// Division: `/`.
    Divide,
}

/// An effect of an action.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Effect {
    /// Several effects: `(and EFFECT*)`. The empty list changes nothing.
    And(Vec<Effect>),
    /// A fact that becomes true: `(PREDICATE TERM*)`.
    Add(Atom),
    /// A fact that becomes false: `(not (PREDICATE TERM*))`.
    Delete(Atom),
    /// A numeric effect, such as `(increase FLUENT EXPRESSION)`.
    Assign(Box<Assign>),
    /// A universal effect: `(forall (VARIABLES) EFFECT)`.
    Forall(Vec<Typed>, Box<Effect>),
    /// A conditional effect: `(when CONDITION EFFECT)`.
    When(Box<Condition>, Box<Effect>),
}

/// A numeric effect: `(ASSIGNMENT FLUENT EXPRESSION)`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Assign {
    /// The operation by which the value of the fluent changes.
    pub assignment: Assignment,
    /// The fluent that the effect changes.
    pub fluent: FluentTerm,
    /// Operand of the operation, evaluated in the state before the action.
    pub value: Expression,
    /// Place in the text, from `(` to `)`.
    pub span: Span,
}

/// The operation of a numeric effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Assignment {
    /// `assign`: the fluent gets the value of the operand.
    Assign,
    /// `increase`: the operand is added to the fluent.
    Increase,
    /// `decrease`: the operand is subtracted from the fluent.
    Decrease,
    /// `scale-up`: the fluent is multiplied by the operand.
    ScaleUp,
    /// `scale-down`: the fluent is divided by the operand.
    ScaleDown,
}

/// Visibility of a predicate or an object (MA-PDDL).
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub enum Privacy {
    /// The predicate or object is visible to every agent.
    #[default]
    Public,
    /// The predicate or object is visible only to the agent that owns it: `(:private …)`. If one
    /// text describes several agents, the owner is given: `(:private ?agent - TYPE …)` (unfactored
    /// privacy).
    Private(Option<Typed>),
}

/// The declaration of a predicate in `:predicates`: `(PREDICATE VARIABLES)`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct PredicateDeclaration {
    /// The predicate symbol.
    pub name: Name,
    /// Parameters of the predicate.
    pub parameters: Vec<Typed>,
    /// Privacy of the predicate: visible to every agent, or only to its owner.
    pub privacy: Privacy,
}

/// Name of the function that adds up the cost of a plan. It has no arguments.
pub const TOTAL_COST: &str = "total-cost";

/// The declaration of a function in `:functions`: `(FUNCTION VARIABLES) [- number]`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct FunctionDeclaration {
    /// The function symbol.
    pub name: Name,
    /// Parameters of the function.
    pub parameters: Vec<Typed>,
    /// Privacy of the function: visible to every agent, or only to its owner.
    pub privacy: Privacy,
}

/// An axiom: `(:derived (PREDICATE VARIABLES) CONDITION)`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Derived {
    /// The predicate that the axiom derives.
    pub predicate: Name,
    /// The variables in the head of the axiom.
    pub parameters: Vec<Typed>,
    /// The body of the axiom: the condition under which the head holds.
    pub condition: Condition,
    /// Place in the text, from `(` to `)`.
    pub span: Span,
}

/// An action: `(:action NAME …)`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ActionSchema {
    /// The action's name.
    pub name: Name,
    /// The acting agent (MA-PDDL), `:agent ?a - TYPE`; `None` if the action has none. In a step of
    /// a plan, the agent comes before the parameters.
    pub agent: Option<Typed>,
    /// Further agents that act at the same time, in a joint action: `:agent (?a ?b - TYPE)`. In a
    /// step of a plan, they come between the agent and the parameters. No two of the agents are the
    /// same.
    pub partners: Vec<Typed>,
    /// The parameters of the action, without the agents.
    pub parameters: Vec<Typed>,
    /// The precondition of the action.
    pub precondition: Condition,
    /// The effect of the action.
    pub effect: Effect,
    /// Predicates and functions in `:observe`. After the action their values are known, whatever
    /// the values are, as in contingent planning. Only action models contain them; `planner`
    /// rejects them.
    pub observe: Vec<Atom>,
    /// Place in the text, from `(` to `)`.
    pub span: Span,
}

/// A durative action (PDDL 2.1): `(:durative-action NAME …)`. The parser and the printer support
/// durative actions, but no planner here does yet.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct DurativeAction {
    /// The action's name.
    pub name: Name,
    /// The acting agent (MA-PDDL); `None` if the action has none.
    pub agent: Option<Typed>,
    /// The parameters of the action, without the agent.
    pub parameters: Vec<Typed>,
    /// The constraints on the duration, `:duration`.
    pub duration: Vec<DurationConstraint>,
    /// The conditions, `:condition`, without nested `and` and `forall`.
    pub conditions: Vec<TimedCondition>,
    /// The effects, `:effect`.
    pub effects: TimedEffect,
    /// Place in the text, from `(` to `)`.
    pub span: Span,
}

/// A constraint on the duration of a durative action: `(= ?duration EXPRESSION)`, or with `<=` or
/// `>=`; also within `(at start …)` or `(at end …)`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct DurationConstraint {
    /// Time at which the expression is evaluated; `None` if the text omits it.
    pub when: Option<TimeSpecifier>,
    /// The comparison of the duration with the bound: `=`, `<=` or `>=`.
    pub comparison: Comparison,
    /// The bound of the duration.
    pub value: Expression,
}

/// A time within a durative action: the start, the end, or the whole interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TimeSpecifier {
    /// The start of the action, `at start`.
    Start,
    /// The end of the action, `at end`.
    End,
    /// The whole interval of the action, `over all`; for conditions only.
    OverAll,
}

/// A condition of a durative action: `[(forall (VARIABLES)] (at start CONDITION)`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct TimedCondition {
    /// The variables of the `forall`s around the condition, outermost first.
    pub forall: Vec<Typed>,
    /// Time at which the condition must hold.
    pub when: TimeSpecifier,
    /// The condition that must hold at this time.
    pub condition: Condition,
}

/// An effect of a durative action.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum TimedEffect {
    /// Several effects: `(and …)`.
    And(Vec<TimedEffect>),
    /// An effect at the start or the end of the action: `(at start|at end EFFECT)`.
    At(TimeSpecifier, Effect),
    /// A universal effect: `(forall (VARIABLES) …)`.
    Forall(Vec<Typed>, Box<TimedEffect>),
    /// A conditional effect: `(when (at start CONDITION) (at end EFFECT))`.
    When(Vec<TimedCondition>, Box<TimedEffect>),
    /// A continuous change of a fluent: `(increase FLUENT (* #t EXPRESSION))`.
    Continuous(Box<Assign>),
}

/// A domain: `(define (domain NAME) …)`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Domain {
    /// The domain's name.
    pub name: Name,
    /// Requirement flags, with their colons, in the author's order.
    pub requirements: Vec<Name>,
    /// Types that the domain declares, each with its supertype.
    pub types: Vec<Typed>,
    /// Objects that exist in every problem of the domain.
    pub constants: Vec<Typed>,
    /// Predicates that the domain declares.
    pub predicates: Vec<PredicateDeclaration>,
    /// Numeric functions that the domain declares.
    pub functions: Vec<FunctionDeclaration>,
    /// Axioms of the domain.
    pub derived: Vec<Derived>,
    /// Actions of the domain.
    pub actions: Vec<ActionSchema>,
    /// Durative actions of the domain.
    pub durative_actions: Vec<DurativeAction>,
}

/// An object of a problem or an action model.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ObjectDeclaration {
    /// The name of the object, with its type.
    pub object: Typed,
    /// Privacy of the object: visible to every agent, or only to its owner.
    pub privacy: Privacy,
}

/// One element of `:init`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum InitElement {
    /// A fact that is true: `(PREDICATE OBJECT*)`.
    Atom(Atom),
    /// A fact that is explicitly false: `(not (PREDICATE OBJECT*))`.
    Not(Atom),
    /// A fact that is neither known to be true nor known to be false, as in contingent planning:
    /// `(unknown (PREDICATE OBJECT*))`. Such facts occur in messages of agents and people;
    /// `planner` rejects them.
    Unknown(Atom),
    /// The value of a function: `(= FLUENT NUMBER)`.
    Assign(FluentTerm, Number),
    /// A timed initial literal: `(at TIME (…))`. The element becomes true at this time.
    At(Number, Box<InitElement>),
}

/// A metric, by which plans are compared: `(:metric minimize|maximize EXPRESSION)`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Metric {
    /// Direction: whether smaller or greater values of the expression are better.
    pub direction: MetricDirection,
    /// The expression, evaluated at the end of the plan.
    pub expression: Expression,
    /// Place in the text, from `(` to `)`.
    pub span: Span,
}

/// The direction in which a metric improves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MetricDirection {
    /// `minimize`: smaller values are better.
    Minimize,
    /// `maximize`: greater values are better.
    Maximize,
}

/// A problem: `(define (problem NAME) …)`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The problem's name.
    pub name: Name,
    /// The name of the domain to which the problem belongs.
    pub domain: Name,
    /// Requirement flags, with their colons.
    pub requirements: Vec<Name>,
    /// Objects of the problem. Clones of the problem share the list, because a building has many
    /// objects and they change less often than its state.
    pub objects: Arc<Vec<ObjectDeclaration>>,
    /// The initial state: facts, and values of functions.
    pub init: Vec<InitElement>,
    /// The condition that must hold at the end of a plan; empty for a problem without `:goal` (a
    /// map).
    pub goal: Condition,
    /// The metric of the problem: the expression to minimise or maximise. `None` if the problem has
    /// none.
    pub metric: Option<Metric>,
}

/// The action model of an agent: `(define (agent NAME) (:domain ONTOLOGY) …)`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ActionModel {
    /// The name of the agent that has the model.
    pub agent: Name,
    /// The name of the shared ontology on which the model builds.
    pub domain: Name,
    /// Requirement flags, with their colons.
    pub requirements: Vec<Name>,
    /// Types that the model adds to the ontology.
    pub types: Vec<Typed>,
    /// Predicates that the model adds to the ontology.
    pub predicates: Vec<PredicateDeclaration>,
    /// Functions that the model adds to the ontology.
    pub functions: Vec<FunctionDeclaration>,
    /// Objects that the agent declares, including itself.
    pub objects: Vec<ObjectDeclaration>,
    /// Facts that the agent reports in its model.
    pub init: Vec<InitElement>,
    /// Axioms that the model adds to the ontology.
    pub derived: Vec<Derived>,
    /// Actions that the agent offers.
    pub actions: Vec<ActionSchema>,
    /// Durative actions that the agent offers.
    pub durative_actions: Vec<DurativeAction>,
}

/// A plan in the format of the International Planning Competition (IPC): one step `(ACTION
/// OBJECT*)` per line.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// The steps of the plan, in order.
    pub steps: Vec<PlanStep>,
    /// The cost from a comment `; cost = N`; `None` without such a comment. The cost is never
    /// trusted, but computed again.
    pub cost: Option<Number>,
}

/// A step of a plan: `[TIME:] (ACTION OBJECT*) [[DURATION]]`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct PlanStep {
    /// The action's name.
    pub action: Name,
    /// The arguments of the action: the agent, if the action has one, then one object for each
    /// parameter.
    pub arguments: Vec<Name>,
    /// Start time of the step, in a temporal plan; `None` in any other plan.
    pub time: Option<Number>,
    /// Duration of the step, in a temporal plan; `None` in any other plan.
    pub duration: Option<Number>,
    /// Place in the text, from `(` to `)`.
    pub span: Span,
}

/// A PDDL file of any kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Document {
    /// A domain: `(define (domain …) …)`.
    Domain(Domain),
    /// A problem: `(define (problem …) …)`.
    Problem(Problem),
    /// An action model: `(define (agent …) …)`.
    ActionModel(ActionModel),
}

// === impl Span ===

impl Span {
    /// Creates the span of the bytes `start..end`.
    pub fn new(start: usize, end: usize) -> Span {
        let clamp = |offset: usize| u32::try_from(offset).unwrap_or(u32::MAX);
        Span { start: clamp(start), end: clamp(end) }
    }

    /// Returns the span as a range, for slicing the text.
    pub fn range(self) -> std::ops::Range<usize> {
        self.start as usize..self.end as usize
    }
}

impl PartialEq for Span {
    fn eq(&self, _: &Span) -> bool {
        true
    }
}

impl Eq for Span {}

impl Hash for Span {
    fn hash<H: Hasher>(&self, _: &mut H) {}
}

// === impl Name ===

impl Name {
    /// Creates a name in the author's spelling, without a place in a text.
    pub fn new(spelled: &str) -> Name {
        Name::spanned(spelled, Span::default())
    }

    /// Creates a name in the author's spelling, with the place `span` in the text.
    pub fn spanned(spelled: &str, span: Span) -> Name {
        let canonical: Box<str> = spelled.to_lowercase().into();
        let spelled = (*canonical != *spelled).then(|| spelled.into());
        Name { spelling: Arc::new(Spelling { canonical, spelled }), span }
    }

    /// Returns the name of a domain or a problem that lacks a valid one. `place` is where the name
    /// is missing.
    pub(crate) fn placeholder(place: Span) -> Name {
        Name::spanned(PLACEHOLDER, Span { end: place.start, ..place })
    }

    /// Whether the parser put this name in the place of a missing or invalid one.
    pub(crate) fn is_placeholder(&self) -> bool {
        let is_written = self.span.end > self.span.start;
        !is_written && self.span.start > 0 && self.as_str() == PLACEHOLDER
    }

    /// Returns a copy of the name that stands at the place `span`.
    pub fn at(&self, span: Span) -> Name {
        Name { spelling: Arc::clone(&self.spelling), span }
    }

    /// Returns the name in lower case. Names are compared in this form.
    pub fn as_str(&self) -> &str {
        &self.spelling.canonical
    }

    /// Returns the name as the author wrote it.
    pub fn spelled(&self) -> &str {
        self.spelling.spelled.as_deref().unwrap_or(&self.spelling.canonical)
    }

    /// Returns the place in the text where the author wrote the name.
    pub fn span(&self) -> Span {
        self.span
    }
}

impl PartialEq for Name {
    fn eq(&self, other: &Name) -> bool {
        Arc::ptr_eq(&self.spelling, &other.spelling) || self.as_str() == other.as_str()
    }
}

impl Eq for Name {}

impl PartialEq<str> for Name {
    fn eq(&self, other: &str) -> bool {
        *self.as_str() == *other
    }
}

impl PartialEq<&str> for Name {
    fn eq(&self, other: &&str) -> bool {
        *self.as_str() == **other
    }
}

impl PartialOrd for Name {
    fn partial_cmp(&self, other: &Name) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Name {
    fn cmp(&self, other: &Name) -> std::cmp::Ordering {
        self.as_str().cmp(other.as_str())
    }
}

impl Hash for Name {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.as_str().hash(state);
    }
}

impl Borrow<str> for Name {
    fn borrow(&self) -> &str {
        self.as_str()
    }
}

impl From<&str> for Name {
    fn from(spelled: &str) -> Name {
        Name::new(spelled)
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.spelled())
    }
}

impl fmt::Debug for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.spelled(), f)
    }
}

// === impl TypeExpr ===

impl TypeExpr {
    /// Creates a type expression with one type.
    pub fn of(name: impl Into<Name>) -> TypeExpr {
        TypeExpr { alternatives: vec![name.into()] }
    }

    /// Whether the author omitted the type or wrote `object`.
    pub fn is_object(&self) -> bool {
        self.alternatives.is_empty() || self.alternatives.iter().any(|name| *name == "object")
    }

    /// Returns the alternatives of the type. The single alternative `object` is equal to an omitted
    /// type, so the result is then empty.
    fn declared_alternatives(&self) -> &[Name] {
        match &self.alternatives[..] {
            [only] if *only == "object" => &[],
            told => told,
        }
    }
}

impl PartialEq for TypeExpr {
    fn eq(&self, other: &TypeExpr) -> bool {
        self.declared_alternatives() == other.declared_alternatives()
    }
}

impl Eq for TypeExpr {}

impl Hash for TypeExpr {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.declared_alternatives().hash(state);
    }
}

// === impl Term ===

impl Term {
    /// Returns the name of the variable or object.
    pub fn name(&self) -> &Name {
        match self {
            Term::Variable(name) | Term::Object(name) => name,
        }
    }
}

// === impl Number ===

impl PartialEq for Number {
    fn eq(&self, other: &Number) -> bool {
        self.0.total_cmp(&other.0).is_eq() || self.0 == other.0
    }
}

impl Eq for Number {}

impl Hash for Number {
    fn hash<H: Hasher>(&self, state: &mut H) {
        // `0.0 == -0.0`, so both must have the same hash.
        let value = if self.0 == 0.0 { 0.0 } else { self.0 };
        value.to_bits().hash(state);
    }
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

// === impl Condition ===

impl Condition {
    /// Returns the condition that always holds: `(and)`.
    pub fn always() -> Condition {
        Condition::And(Vec::new())
    }

    /// Whether the condition is the empty conjunction, which always holds.
    pub fn is_always(&self) -> bool {
        matches!(self, Condition::And(parts) if parts.is_empty())
    }
}

impl Default for Condition {
    fn default() -> Condition {
        Condition::always()
    }
}

impl Default for Effect {
    fn default() -> Effect {
        Effect::nothing()
    }
}

impl Effect {
    /// Returns the effect that changes nothing: `(and)`.
    pub fn nothing() -> Effect {
        Effect::And(Vec::new())
    }
}

impl Domain {
    /// Creates a domain without declarations.
    pub fn named(name: impl Into<Name>) -> Domain {
        Domain {
            name: name.into(),
            requirements: Vec::new(),
            types: Vec::new(),
            constants: Vec::new(),
            predicates: Vec::new(),
            functions: Vec::new(),
            derived: Vec::new(),
            actions: Vec::new(),
            durative_actions: Vec::new(),
        }
    }
}

impl InitElement {
    /// Returns the place of the element in the text. For a timed initial literal, returns the place
    /// of the fact in it.
    pub fn span(&self) -> Span {
        match self {
            InitElement::Atom(atom) | InitElement::Not(atom) | InitElement::Unknown(atom) => {
                atom.span
            }
            InitElement::Assign(fluent, _) => fluent.span,
            InitElement::At(_, later) => later.span(),
        }
    }
}

impl Problem {
    /// Returns the first timed initial literal of the problem; `None` if there is none.
    pub fn timed_literal(&self) -> Option<&InitElement> {
        self.init.iter().find(|element| matches!(element, InitElement::At(..)))
    }

    /// Returns the first element `(unknown …)` of the problem; `None` if there is none.
    pub fn unknown_fact(&self) -> Option<&InitElement> {
        self.init.iter().find(|element| matches!(element, InitElement::Unknown(_)))
    }

    /// Creates a problem of `domain` without objects, facts and a goal.
    pub fn named(name: impl Into<Name>, domain: impl Into<Name>) -> Problem {
        Problem {
            name: name.into(),
            domain: domain.into(),
            requirements: Vec::new(),
            objects: Arc::default(),
            init: Vec::new(),
            goal: Condition::always(),
            metric: None,
        }
    }
}

impl ActionModel {
    /// Creates an action model of `agent` without actions.
    pub fn of(agent: impl Into<Name>, domain: impl Into<Name>) -> ActionModel {
        ActionModel {
            agent: agent.into(),
            domain: domain.into(),
            requirements: Vec::new(),
            types: Vec::new(),
            predicates: Vec::new(),
            functions: Vec::new(),
            objects: Vec::new(),
            init: Vec::new(),
            derived: Vec::new(),
            actions: Vec::new(),
            durative_actions: Vec::new(),
        }
    }
}

impl ActionSchema {
    /// Returns the agents, if the action has any, and then the parameters. The arguments of a step
    /// have this order.
    pub fn all_parameters(&self) -> impl Iterator<Item = &Typed> {
        self.agents().chain(&self.parameters)
    }

    /// Returns the agents that act in the action: none, one, or several in a joint action. They are
    /// the first arguments of a step.
    pub fn agents(&self) -> impl Iterator<Item = &Typed> {
        self.agent.iter().chain(&self.partners)
    }
}

impl DurativeAction {
    /// Returns the agent, if the action has one, and then the parameters. The arguments of a step
    /// have this order.
    pub fn all_parameters(&self) -> impl Iterator<Item = &Typed> {
        self.agent.iter().chain(&self.parameters)
    }
}

impl PlanStep {
    /// Creates a step of a plan, without times and without a place in a text.
    pub fn new(action: impl Into<Name>, arguments: impl IntoIterator<Item = Name>) -> PlanStep {
        PlanStep {
            action: action.into(),
            arguments: arguments.into_iter().collect(),
            time: None,
            duration: None,
            span: Span::default(),
        }
    }
}
