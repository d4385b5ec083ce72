//! The standard ontology of buildings, and maps made from rooms and doors.
//!
//! - [`STANDARD_DOMAIN`] is the ontology as text, [`standard_domain`] as a tree.
//! - [`extended`] adds the words of one building to it: types, predicates, functions, axioms.
//! - [`BuildingPlan`] turns places and doors into a map, which is a PDDL problem.
//! - [`place_name_problem`] says why a text cannot be the name of a place, and what could.
//!
//! Reading an ecosystem file is left to the daemon, and phrases for people to another crate. Names
//! carry the spans of the author's text, so that a mistake found in the map is shown where its
//! author wrote it.
//!
//! **Invariant:** nothing here reads a file, a clock or the environment.

mod building_plan;
mod place_names;
mod vocabulary;

use std::sync::LazyLock;

use pddl::Domain;

pub use building_plan::{BuildingPlan, PlanDoor, PlanPlace, PlanStatement};
pub use place_names::{floor_name, place_name_problem};
pub use vocabulary::extended;

/// The standard ontology, as the text of a PDDL domain.
pub const STANDARD_DOMAIN: &str = include_str!("standard.pddl");

/// The name of the standard ontology in action models: `(:domain smart-office)`, because it is that
/// of the paper's office with more words, and models written for the office fit. An ontology that
/// extends the standard one has the same name, so that an action model fits every building.
pub const STANDARD_NAME: &str = "smart-office";

/// Name of the standard ontology's text in messages.
pub const STANDARD_SOURCE: &str = "the standard ontology";

/// Returns the standard ontology.
pub fn standard_domain() -> &'static Domain {
    static DOMAIN: LazyLock<Domain> = LazyLock::new(|| {
        let parsed = pddl::parse_domain(STANDARD_DOMAIN);
        parsed.value.expect("invariant: a test parses the standard ontology")
    });
    &DOMAIN
}
