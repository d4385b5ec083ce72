//! A building as its owner describes it, places and doors, and the map that follows from it.

use std::collections::BTreeSet;
use std::sync::Arc;

use pddl::{
    Atom, Condition, Expression, FluentTerm, InitElement, Metric, MetricDirection, Name, Number,
    ObjectDeclaration, Privacy, Problem, Span, Term, TypeExpr, Typed,
};

/// The places of a building and the doors between them.
#[derive(Clone, Debug, Default)]
pub struct BuildingPlan {
    /// The places, in the order of the map.
    pub places: Vec<PlanPlace>,
    /// The doors, in the order of the map.
    pub doors: Vec<PlanDoor>,
}

/// A place of a building: a room, a corridor, a garden.
#[derive(Clone, Debug)]
pub struct PlanPlace {
    /// The name of the place, with its span in the author's text.
    pub name: Name,
    /// The type of the place in the ontology.
    pub kind: Name,
    /// What else the author says of the place.
    pub statements: Vec<PlanStatement>,
}

/// A statement about one place.
#[derive(Clone, Debug)]
pub enum PlanStatement {
    /// The fact `(PREDICATE PLACE)`.
    Holds {
        /// The predicate.
        predicate: Name,
    },
    /// The fact `(PREDICATE PLACE OBJECT)`.
    Relates {
        /// The predicate.
        predicate: Name,
        /// The object, with the type of which it is, if it is no place.
        object: Typed,
    },
    /// The value `(= (FUNCTION PLACE) NUMBER)`.
    Measures {
        /// The function.
        function: Name,
        /// The value of the function.
        value: f64,
    },
}

/// A door, or any other way between two neighboring places.
#[derive(Clone, Debug)]
pub struct PlanDoor {
    /// The place that the door leads from.
    pub from: Name,
    /// The place that the door leads to; its span is that of the door.
    pub to: Name,
    /// The length of the way, in meters.
    pub meters: f64,
    /// Whether the door does not lead back.
    pub is_one_way: bool,
}

// === impl BuildingPlan ===

impl BuildingPlan {
    /// Returns the map of the building, as a problem of the ontology `domain`. Each door is in the map
    /// once for each direction. Objects that are no places, such as floors, are declared where they
    /// are first named.
    pub fn map(&self, ecosystem: &str, domain: &Name) -> Problem {
        let mut problem = Problem::named(format!("{ecosystem}-map").as_str(), domain.clone());
        let total_cost = || fluent(pddl::TOTAL_COST, Vec::new(), Span::default());
        problem.init.push(InitElement::Assign(total_cost(), Number(0.0)));
        problem.metric = Some(Metric {
            direction: MetricDirection::Minimize,
            expression: Expression::Fluent(total_cost()),
            span: Span::default(),
        });
        problem.goal = Condition::always();
        problem.objects = Arc::new(self.objects());
        for place in &self.places {
            problem.init.extend(place.statements.iter().map(|said| said.element(&place.name)));
        }
        for door in &self.doors {
            problem.init.extend(door.elements());
        }
        problem
    }

    fn objects(&self) -> Vec<ObjectDeclaration> {
        let mut known: BTreeSet<&Name> = self.places.iter().map(|place| &place.name).collect();
        let typed = |name: &Name, kind: &Name| Typed {
            name: name.clone(),
            ty: TypeExpr { alternatives: vec![kind.clone()] },
        };
        let mut objects: Vec<Typed> =
            self.places.iter().map(|place| typed(&place.name, &place.kind)).collect();
        let statements = self.places.iter().flat_map(|place| &place.statements);
        for said in statements {
            if let PlanStatement::Relates { object, .. } = said
                && known.insert(&object.name)
            {
                objects.push(object.clone());
            }
        }
        let declared = |object| ObjectDeclaration { object, privacy: Privacy::Public };
        objects.into_iter().map(declared).collect()
    }
}

impl PlanStatement {
    fn element(&self, place: &Name) -> InitElement {
        let subject = Term::Object(place.clone());
        match self {
            PlanStatement::Holds { predicate } => {
                InitElement::Atom(atom(predicate.clone(), vec![subject], predicate.span()))
            }
            PlanStatement::Relates { predicate, object } => {
                let arguments = vec![subject, Term::Object(object.name.clone())];
                InitElement::Atom(atom(predicate.clone(), arguments, predicate.span()))
            }
            PlanStatement::Measures { function, value } => {
                let term = fluent(function.clone(), vec![subject], function.span());
                InitElement::Assign(term, Number(*value))
            }
        }
    }
}

impl PlanDoor {
    /// Returns the facts about the door: that it leads to the other place, and how far that is.
    fn elements(&self) -> Vec<InitElement> {
        let span = self.to.span();
        let way = |from: &Name, to: &Name| {
            let places = || vec![Term::Object(from.clone()), Term::Object(to.clone())];
            let length = fluent("distance", places(), span);
            [
                InitElement::Atom(atom("connected", places(), span)),
                InitElement::Assign(length, Number(self.meters)),
            ]
        };
        let mut elements = Vec::from(way(&self.from, &self.to));
        if !self.is_one_way {
            elements.extend(way(&self.to, &self.from));
        }
        elements
    }
}

fn atom(predicate: impl Into<Name>, arguments: Vec<Term>, span: Span) -> Atom {
    Atom { predicate: predicate.into(), arguments, span }
}

fn fluent(function: impl Into<Name>, arguments: Vec<Term>, span: Span) -> FluentTerm {
    FluentTerm { function: function.into(), arguments, span }
}
