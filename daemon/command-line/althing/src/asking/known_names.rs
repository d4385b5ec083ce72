//! The names of a running ecosystem, which goals in words may contain.

use acl::content::Snapshot;
use agent::Resource;
use phrases::KnownNames;

use crate::ecosystem_view::EcosystemView;

/// Returns the objects, types and predicates of the ecosystem as it is now. If no Domain Maintainer
/// answers, every name is possible.
pub(crate) async fn known_names(view: &EcosystemView) -> KnownNames {
    let maintainer = &view.roles().domain_maintainer;
    view.directory(Some(maintainer)).await;
    let answers = view.ask(Resource::Domain, Some(maintainer.clone())).await;
    let snapshot = answers.first().and_then(|bytes| serde_json::from_slice::<Snapshot>(bytes).ok());
    snapshot.map(|snapshot| of_snapshot(&snapshot)).unwrap_or_default()
}

/// Returns the names of a composite domain and problem.
pub(crate) fn of_snapshot(snapshot: &Snapshot) -> KnownNames {
    let domain = pddl::parse_domain(&snapshot.domain).value;
    let problem = pddl::parse_problem(&snapshot.problem).value;
    match (domain, problem) {
        (Some(domain), Some(problem)) => KnownNames::of(&domain, &problem),
        _ => KnownNames::default(),
    }
}
