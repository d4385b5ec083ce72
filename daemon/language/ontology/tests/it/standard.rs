//! Tests of the standard ontology itself, and of what the buildings of the repository need of it.

use ontology::{STANDARD_DOMAIN, STANDARD_NAME, standard_domain};
use pddl::{Domain, Typed, Types};

const OFFICE: &str = include_str!("../../../../../domains/smart-office/domain.pddl");

#[test]
fn the_standard_ontology_has_no_mistake_and_no_actions() {
    let parsed = pddl::parse_domain(STANDARD_DOMAIN);
    assert_eq!(parsed.diagnostics, []);
    let domain = parsed.value.expect("a domain");
    assert_eq!(pddl::check_domain(&domain), []);
    assert_eq!(domain.name, STANDARD_NAME);
    assert!(domain.actions.is_empty() && domain.durative_actions.is_empty());
    let again = pddl::parse_domain(&domain.to_string()).value.expect("it is printed as PDDL");
    assert_eq!(&again, standard_domain());
}

/// Goals of the smart office keep their text: each word means the same in both.
#[test]
fn every_word_of_the_smart_office_is_in_the_standard_ontology() {
    let office = pddl::parse_domain(OFFICE).value.expect("a domain");
    let standard = standard_domain();
    let types = Types::of(standard);
    for declared in &office.types {
        for above in &declared.ty.alternatives {
            let (below, above) = (declared.name.as_str(), above.as_str());
            assert!(above == "object" || types.is_subtype(below, above), "{below} - {above}");
        }
    }
    let kinds =
        |parameters: &[Typed]| parameters.iter().map(|it| it.ty.clone()).collect::<Vec<_>>();
    for declared in &office.predicates {
        let same = standard.predicates.iter().find(|known| known.name == declared.name);
        let same = same.unwrap_or_else(|| panic!("no predicate {}", declared.name));
        assert_eq!(kinds(&same.parameters), kinds(&declared.parameters), "{}", declared.name);
    }
    for declared in &office.functions {
        let same = standard.functions.iter().find(|known| known.name == declared.name);
        let same = same.unwrap_or_else(|| panic!("no function {}", declared.name));
        assert_eq!(kinds(&same.parameters), kinds(&declared.parameters), "{}", declared.name);
    }
    for axiom in &office.derived {
        assert!(standard.derived.contains(axiom), "{axiom}");
    }
}

/// The author of a goal finds the unit of a number in the text of the ontology.
#[test]
fn every_function_has_its_unit_beside_it() {
    let Domain { functions, .. } = standard_domain();
    for function in functions.iter().filter(|function| function.name != "total-cost") {
        let opening = format!("({} ?", function.name);
        let mut lines = STANDARD_DOMAIN.lines().filter(|line| line.contains(&opening));
        let has_unit = |line: &str| {
            let comment = line.split_once(';').map_or("", |(_, comment)| comment);
            let units =
                ["meter", "°C", " %", "in %", "ppm", "lx", " W", "kWh", "in K", "relative, in %"];
            units.iter().any(|unit| comment.contains(unit))
        };
        assert!(lines.any(has_unit), "no unit beside {}", function.name);
    }
}
