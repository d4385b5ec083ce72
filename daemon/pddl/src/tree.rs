//! The syntax tree: the content of a PDDL text, before its meaning is checked.
//!
//! - Built by the parser, printed by the printer, read by `check`, `capability` and `planner`.
//! - Everything here is *lifted*: parameters are variables. Ground things are in `planner`.
//! - Two trees are equal if they have the same content: spans and the author's spelling are not compared.

use std::borrow::Borrow;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::sync::Arc;

/// A range of bytes in the author's text, `start..end`.
///
/// All spans are equal, so that trees are compared by their content and not by the places in a text.
#[derive(Clone, Copy, Debug, Default)]
pub struct Span {
    /// First byte.
    pub start: u32,
    /// One past the last byte.
    pub end: u32,
}

/// A PDDL symbol: compared without case, printed as its author wrote it.
///
/// Variables are names too, without the question mark.
///
/// Cheap to clone: the parser allocates a spelling once for each text, however often it occurs.
#[derive(Clone)]
pub struct Name {
    spelling: Arc<Spelling>,
    span: Span,
}

struct Spelling {
    canonical: Box<str>,
    /// Set only if it differs from `canonical`.
    spelled: Option<Box<str>>,
}

/// `TYPE | (either TYPE+)`; the empty list stands for an omitted type, which is `object`.
///
/// `object` alone and the empty list are equal.
#[derive(Clone, Debug, Default)]
pub struct TypeExpr {
    /// One type, or the alternatives of an `either`, in the author's order.
    pub alternatives: Vec<Name>,
}

/// A name with a type: a variable, a constant, an object, or a type with its supertype.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Typed {
    /// The name; of a variable, without `?`.
    pub name: Name,
    /// Its type; of a type, its supertype.
    pub ty: TypeExpr,
}

/// A variable or an object in argument position.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Term {
    /// `?name`
    Variable(Name),
    /// `name`: a constant or an object.
    Object(Name),
}

/// `(PREDICATE TERM*)`
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Atom {
    /// The predicate symbol.
    pub predicate: Name,
    /// One term per parameter of the predicate.
    pub arguments: Vec<Term>,
    /// From `(` to `)`.
    pub span: Span,
}

/// `(FUNCTION TERM*)`, or `FUNCTION` alone if the function takes no argument.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct FluentTerm {
    /// The function symbol.
    pub function: Name,
    /// One term per parameter of the function.
    pub arguments: Vec<Term>,
    /// From `(` to `)`.
    pub span: Span,
}

/// A finite number. Equal by value, so `1`, `1.0` and `1e0` are one number.
#[derive(Clone, Copy, Debug)]
pub struct Number(pub f64);

/// A condition: of an action, an effect, an axiom, or a goal.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Condition {
    /// `(PREDICATE TERM*)`
    Atom(Atom),
    /// `(= TERM TERM)`
    Equal(Term, Term, Span),
    /// `(< EXPRESSION EXPRESSION)` and its kin.
    Compare(Box<Compare>),
    /// `(not CONDITION)`
    Not(Box<Condition>),
    /// `(and CONDITION*)`; empty, it is true. An omitted or empty `()` condition is this too.
    And(Vec<Condition>),
    /// `(or CONDITION*)`; empty, it is false.
    Or(Vec<Condition>),
    /// `(imply CONDITION CONDITION)`
    Imply(Box<Condition>, Box<Condition>),
    /// `(exists (VARIABLES) CONDITION)`
    Exists(Vec<Typed>, Box<Condition>),
    /// `(forall (VARIABLES) CONDITION)`
    Forall(Vec<Typed>, Box<Condition>),
}

/// `(COMPARISON EXPRESSION EXPRESSION)`
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Compare {
    /// The comparison operator.
    pub comparison: Comparison,
    /// The left side.
    pub left: Expression,
    /// The right side.
    pub right: Expression,
    /// From `(` to `)`.
    pub span: Span,
}

/// A numeric comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Comparison {
    /// `<`
    Less,
    /// `<=`
    LessOrEqual,
    /// `=` between numbers.
    Equal,
    /// `>=`
    GreaterOrEqual,
    /// `>`
    Greater,
}

/// A numeric expression.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Expression {
    /// A number.
    Number(Number),
    /// `(FUNCTION TERM*)`
    Fluent(FluentTerm),
    /// `(- EXPRESSION)`
    Negate(Box<Expression>),
    /// `(+ E E+)`, `(- E E)`, `(* E E+)`, `(/ E E)`; `+` and `*` take two or more operands.
    Apply(Operator, Vec<Expression>),
    /// `?duration`, in the constraints, conditions and effects of a durative action.
    Duration(Span),
    /// `#t`, in a continuous effect.
    ContinuousTime(Span),
    /// `total-time`, in a metric.
    TotalTime(Span),
}

/// An arithmetic operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Operator {
    /// `+`
    Add,
    /// `-`
    Subtract,
    /// `*`
    Multiply,
    /// `/`
    Divide,
}

/// An effect of an action.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Effect {
    /// `(and EFFECT*)`; empty, nothing happens.
    And(Vec<Effect>),
    /// `(PREDICATE TERM*)`
    Add(Atom),
    /// `(not (PREDICATE TERM*))`
    Delete(Atom),
    /// `(increase FLUENT EXPRESSION)` and its kin.
    Assign(Box<Assign>),
    /// `(forall (VARIABLES) EFFECT)`
    Forall(Vec<Typed>, Box<Effect>),
    /// `(when CONDITION EFFECT)`
    When(Box<Condition>, Box<Effect>),
}

/// `(ASSIGNMENT FLUENT EXPRESSION)`
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Assign {
    /// The operation on the value.
    pub assignment: Assignment,
    /// The fluent that changes.
    pub fluent: FluentTerm,
    /// The value, read in the state before the action.
    pub value: Expression,
    /// From `(` to `)`.
    pub span: Span,
}

/// A numeric effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Assignment {
    /// `assign`
    Assign,
    /// `increase`
    Increase,
    /// `decrease`
    Decrease,
    /// `scale-up`
    ScaleUp,
    /// `scale-down`
    ScaleDown,
}

/// Visibility of a predicate or an object (MA-PDDL).
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub enum Privacy {
    /// Visible to every agent.
    #[default]
    Public,
    /// Visible to its agent only: `(:private …)`, or `(:private ?agent - TYPE …)` if one text
    /// describes several agents (unfactored privacy).
    Private(Option<Typed>),
}

/// `(PREDICATE VARIABLES)` in `:predicates`
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct PredicateDeclaration {
    /// The predicate symbol.
    pub name: Name,
    /// Its parameters.
    pub parameters: Vec<Typed>,
    /// Visibility to other agents.
    pub privacy: Privacy,
}

/// `(FUNCTION VARIABLES) [- number]` in `:functions`
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct FunctionDeclaration {
    /// The function symbol.
    pub name: Name,
    /// Its parameters.
    pub parameters: Vec<Typed>,
    /// Visibility to other agents.
    pub privacy: Privacy,
}

/// `(:derived (PREDICATE VARIABLES) CONDITION)`: an axiom.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Derived {
    /// The predicate it derives.
    pub predicate: Name,
    /// The variables of the head.
    pub parameters: Vec<Typed>,
    /// The body.
    pub condition: Condition,
    /// From `(` to `)`.
    pub span: Span,
}

/// `(:action NAME …)`
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ActionSchema {
    /// The action's name.
    pub name: Name,
    /// `:agent ?a - TYPE`: the acting agent (MA-PDDL). It precedes the parameters in a plan's step.
    pub agent: Option<Typed>,
    /// The parameters, without the agent.
    pub parameters: Vec<Typed>,
    /// The precondition.
    pub precondition: Condition,
    /// The effect.
    pub effect: Effect,
    /// `:observe`: predicates and functions with a value that is known after the action, whatever
    /// it is, as in contingent planning. In action models only; `planner` rejects it.
    pub observe: Vec<Atom>,
    /// From `(` to `)`.
    pub span: Span,
}

/// `(:durative-action NAME …)` (PDDL 2.1). Parsed and printed; no planner here uses it yet.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct DurativeAction {
    /// The action's name.
    pub name: Name,
    /// The acting agent.
    pub agent: Option<Typed>,
    /// The parameters, without the agent.
    pub parameters: Vec<Typed>,
    /// `:duration`
    pub duration: Vec<DurationConstraint>,
    /// `:condition`, flattened over `and` and `forall`.
    pub conditions: Vec<TimedCondition>,
    /// `:effect`
    pub effects: TimedEffect,
    /// From `(` to `)`.
    pub span: Span,
}

/// `[(at start|at end] (= ?duration EXPRESSION)`
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct DurationConstraint {
    /// When the expression is evaluated; `None` if the author left it out.
    pub when: Option<TimeSpecifier>,
    /// `=`, `<=` or `>=`.
    pub comparison: Comparison,
    /// The bound.
    pub value: Expression,
}

/// A point or the interval of a durative action.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TimeSpecifier {
    /// `at start`
    Start,
    /// `at end`
    End,
    /// `over all`; of conditions only.
    OverAll,
}

/// `[(forall (VARIABLES)] (at start CONDITION)`
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct TimedCondition {
    /// The variables of enclosing `forall`s, outermost first.
    pub forall: Vec<Typed>,
    /// When the condition must hold.
    pub when: TimeSpecifier,
    /// The condition.
    pub condition: Condition,
}

/// An effect of a durative action.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum TimedEffect {
    /// `(and …)`
    And(Vec<TimedEffect>),
    /// `(at start|at end EFFECT)`
    At(TimeSpecifier, Effect),
    /// `(forall (VARIABLES) …)`
    Forall(Vec<Typed>, Box<TimedEffect>),
    /// `(when (at start CONDITION) (at end EFFECT))`
    When(Vec<TimedCondition>, Box<TimedEffect>),
    /// `(increase FLUENT (* #t EXPRESSION))`: continuous change.
    Continuous(Box<Assign>),
}

/// `(define (domain NAME) …)`
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Domain {
    /// The domain's name.
    pub name: Name,
    /// Requirement flags, with their colon, in the author's order.
    pub requirements: Vec<Name>,
    /// Types, each with its supertype.
    pub types: Vec<Typed>,
    /// Objects that exist in every problem.
    pub constants: Vec<Typed>,
    /// Predicates.
    pub predicates: Vec<PredicateDeclaration>,
    /// Numeric functions.
    pub functions: Vec<FunctionDeclaration>,
    /// Axioms.
    pub derived: Vec<Derived>,
    /// Actions.
    pub actions: Vec<ActionSchema>,
    /// Durative actions.
    pub durative_actions: Vec<DurativeAction>,
}

/// An object of a problem or an action model.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ObjectDeclaration {
    /// The object and its type.
    pub object: Typed,
    /// Visibility to other agents.
    pub privacy: Privacy,
}

/// One element of `:init`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum InitElement {
    /// `(PREDICATE OBJECT*)`
    Atom(Atom),
    /// `(not (PREDICATE OBJECT*))`: explicitly false.
    Not(Atom),
    /// `(unknown (PREDICATE OBJECT*))`: neither known to be true nor known to be false, as in
    /// contingent planning. Used in messages of agents and people; `planner` rejects it.
    Unknown(Atom),
    /// `(= FLUENT NUMBER)`
    Assign(FluentTerm, Number),
    /// `(at TIME (…))`: a timed initial literal.
    At(Number, Box<InitElement>),
}

/// `(:metric minimize|maximize EXPRESSION)`
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Metric {
    /// The direction of improvement.
    pub direction: MetricDirection,
    /// The expression, evaluated at the end of the plan.
    pub expression: Expression,
    /// From `(` to `)`.
    pub span: Span,
}

/// The direction in which a metric improves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MetricDirection {
    /// `minimize`
    Minimize,
    /// `maximize`
    Maximize,
}

/// `(define (problem NAME) …)`
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The problem's name.
    pub name: Name,
    /// The domain it belongs to.
    pub domain: Name,
    /// Requirement flags, with their colon.
    pub requirements: Vec<Name>,
    /// Objects. Clones share them: a building has many objects, and they change less often than its
    /// state.
    pub objects: Arc<Vec<ObjectDeclaration>>,
    /// The initial state.
    pub init: Vec<InitElement>,
    /// The condition that must hold at the end; empty for a problem without `:goal` (a map).
    pub goal: Condition,
    /// The expression to minimise or maximise at the end.
    pub metric: Option<Metric>,
}

/// `(define (agent NAME) (:domain ONTOLOGY) …)`: the action model of an agent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ActionModel {
    /// The agent.
    pub agent: Name,
    /// The shared ontology that the model builds on.
    pub domain: Name,
    /// Requirement flags, with their colon.
    pub requirements: Vec<Name>,
    /// Types that the model adds.
    pub types: Vec<Typed>,
    /// Predicates that the model adds.
    pub predicates: Vec<PredicateDeclaration>,
    /// Functions that the model adds.
    pub functions: Vec<FunctionDeclaration>,
    /// Objects that the agent brings, including itself.
    pub objects: Vec<ObjectDeclaration>,
    /// Facts that the agent knows.
    pub init: Vec<InitElement>,
    /// Axioms that the model adds.
    pub derived: Vec<Derived>,
    /// Actions that the agent offers.
    pub actions: Vec<ActionSchema>,
    /// Durative actions that the agent offers.
    pub durative_actions: Vec<DurativeAction>,
}

/// A plan in the IPC's format: one step per line, `(ACTION OBJECT*)`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// The steps, in order.
    pub steps: Vec<PlanStep>,
    /// Cost claimed by a `; cost = N` comment. Never trusted; recomputed.
    pub cost: Option<Number>,
}

/// `[TIME:] (ACTION OBJECT*) [[DURATION]]`
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct PlanStep {
    /// The action's name.
    pub action: Name,
    /// The agent, if the schema has one, then one object per parameter.
    pub arguments: Vec<Name>,
    /// Start time, in a temporal plan.
    pub time: Option<Number>,
    /// Duration, in a temporal plan.
    pub duration: Option<Number>,
    /// From `(` to `)`.
    pub span: Span,
}

/// A PDDL text that is a file of its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Document {
    /// `(define (domain …) …)`
    Domain(Domain),
    /// `(define (problem …) …)`
    Problem(Problem),
    /// `(define (agent …) …)`
    ActionModel(ActionModel),
}

// === impl Span ===

impl Span {
    /// Creates the span of the bytes `start..end`.
    pub fn new(start: usize, end: usize) -> Span {
        let clamp = |offset: usize| u32::try_from(offset).unwrap_or(u32::MAX);
        Span { start: clamp(start), end: clamp(end) }
    }

    /// Returns the range for slicing the text.
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
    /// Creates a name as its author spelled it, without a place in a text.
    pub fn new(spelled: &str) -> Name {
        Name::spanned(spelled, Span::default())
    }

    /// Creates a name as its author spelled it at `span`.
    pub fn spanned(spelled: &str, span: Span) -> Name {
        let canonical: Box<str> = spelled.to_lowercase().into();
        let spelled = (*canonical != *spelled).then(|| spelled.into());
        Name { spelling: Arc::new(Spelling { canonical, spelled }), span }
    }

    /// Returns the same name at another place.
    pub fn at(&self, span: Span) -> Name {
        Name { spelling: Arc::clone(&self.spelling), span }
    }

    /// Returns the name in lower case, by which names are compared.
    pub fn as_str(&self) -> &str {
        &self.spelling.canonical
    }

    /// Returns the name as the author wrote it.
    pub fn spelled(&self) -> &str {
        self.spelling.spelled.as_deref().unwrap_or(&self.spelling.canonical)
    }

    /// Returns the place where the author wrote it.
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
    /// Creates an expression of one type.
    pub fn of(name: impl Into<Name>) -> TypeExpr {
        TypeExpr { alternatives: vec![name.into()] }
    }

    /// Whether the author left the type out or wrote `object`.
    pub fn is_object(&self) -> bool {
        self.alternatives.is_empty() || self.alternatives.iter().any(|name| *name == "object")
    }

    /// Returns the alternatives; empty if the only one is `object`, which is the same as no type.
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
    /// Returns the name of the variable or the object.
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
    /// Returns the condition that always holds.
    pub fn always() -> Condition {
        Condition::And(Vec::new())
    }

    /// Whether this is the empty conjunction.
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
    /// Returns the effect that changes nothing.
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
    /// Returns the place in the text; for a timed initial literal, that of the fact.
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
    /// Returns the first timed initial literal.
    pub fn timed_literal(&self) -> Option<&InitElement> {
        self.init.iter().find(|element| matches!(element, InitElement::At(..)))
    }

    /// Returns the first fact that is declared unknown.
    pub fn unknown_fact(&self) -> Option<&InitElement> {
        self.init.iter().find(|element| matches!(element, InitElement::Unknown(_)))
    }

    /// Creates a problem of `domain` without objects, facts and goal.
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
    /// Creates the model of an agent without actions.
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
    /// Returns the agent, if there is one, then the parameters: the order of a plan's arguments.
    pub fn all_parameters(&self) -> impl Iterator<Item = &Typed> {
        self.agent.iter().chain(&self.parameters)
    }
}

impl DurativeAction {
    /// Returns the agent, if there is one, then the parameters: the order of a plan's arguments.
    pub fn all_parameters(&self) -> impl Iterator<Item = &Typed> {
        self.agent.iter().chain(&self.parameters)
    }
}

impl PlanStep {
    /// Creates a step without time and place.
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
