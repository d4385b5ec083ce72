//! The requester's side: plans over the projections of all members, and splits the skeleton.

use std::collections::{BTreeMap, BTreeSet};

use acl::content::PartStep;
use acl::fnv::Fnv64;
use pddl::factored::{AgentFiles, FactoredTask, merge_factored};
use pddl::{Domain, InitElement, Name, Plan, PlanStep, TOTAL_COST, Term};
use planner::{Cancel, Options, PlanError, StopReason, World};

use crate::opaque_names::{OWN, check_member_name, opaque_words};
use crate::projection::Projection;
use crate::terms::used_by;

/// Maximum size of the texts of one projection, in bytes. Those of the CoDMAP competition have at
/// most some 200 KiB.
const PROJECTION_BYTES_MAX: usize = 4 << 20;

/// A task that is merged from projections.
pub struct SkeletonTask {
    merged: FactoredTask,
    /// The names that each member's projection declares.
    known: BTreeMap<String, MemberNames>,
}

/// The names that one projection declares.
struct MemberNames {
    actions: BTreeSet<Name>,
    symbols: BTreeSet<Name>,
    objects: BTreeSet<Name>,
    /// Texts of the facts and values of the initial state that the projection states.
    stated: BTreeSet<String>,
}

/// A plan over projections.
#[derive(Clone, Debug, PartialEq)]
pub struct SkeletonPlan {
    /// The owner of each step, in the order of the skeleton.
    pub owners: Vec<String>,
    /// The part of each member that acts in the skeleton.
    pub parts: BTreeMap<String, Vec<PartStep>>,
    /// Digest of the whole skeleton.
    pub digest: String,
}

impl SkeletonPlan {
    /// Joins the filled parts of all members (the groups of [`FilledPart::steps`]) in the order of the
    /// skeleton. Each step comes with its member.
    ///
    /// [`FilledPart::steps`]: crate::FilledPart::steps
    #[must_use]
    pub fn join(&self, parts: BTreeMap<String, Vec<Vec<PlanStep>>>) -> Vec<(String, PlanStep)> {
        let mut rest: BTreeMap<String, std::vec::IntoIter<Vec<PlanStep>>> =
            parts.into_iter().map(|(member, groups)| (member, groups.into_iter())).collect();
        let mut joined = Vec::new();
        let mut add = |member: &str, group: Option<Vec<PlanStep>>| {
            joined.extend(group.into_iter().flatten().map(|step| (member.to_owned(), step)));
        };
        rest.iter_mut().for_each(|(member, groups)| add(member, groups.next()));
        for owner in &self.owners {
            add(owner, rest.get_mut(owner).and_then(Iterator::next));
        }
        for (member, groups) in rest {
            groups.for_each(|group| add(&member, Some(group)));
        }
        joined
    }
}

/// The result of planning over projections.
#[derive(Clone, Debug, PartialEq)]
pub enum SkeletonOutcome {
    /// A skeleton was found.
    Found(SkeletonPlan),
    /// Proved: not even with the dropped requirements is there a plan. So the members have no joint
    /// plan.
    NoPlan,
    /// The search ended at a limit.
    Undecided(StopReason),
}

/// A reason why there is no skeleton task, or why it cannot be planned for, as text for a person.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkeletonError {
    /// The member with a wrong projection; `None` if the projections do not fit together.
    pub member: Option<String>,
    /// The reason.
    pub why: String,
}

// === impl SkeletonTask ===

impl SkeletonTask {
    /// Merges the projections of all members.
    ///
    /// # Errors
    ///
    /// Returns the reason if a projection cannot be parsed, takes a name of another member, or
    /// contradicts the others.
    pub fn merge(
        projections: &BTreeMap<String, Projection>,
    ) -> Result<SkeletonTask, SkeletonError> {
        let mut files = Vec::new();
        let mut known = BTreeMap::new();
        for (member, projection) in projections {
            let parsed = parsed(member, projection)
                .map_err(|why| SkeletonError { member: Some(member.clone()), why })?;
            known.insert(member.clone(), MemberNames::of(&parsed));
            files.push(parsed);
        }
        let goals_known = without_unknown_goals(files);
        let merged =
            merge_factored(&goals_known).map_err(|why| SkeletonError { member: None, why })?;
        Ok(SkeletonTask { merged, known })
    }

    /// Searches for a skeleton.
    ///
    /// # Errors
    ///
    /// Returns the reason if the merged task makes no sense.
    pub fn plan(
        &self,
        options: &Options,
        cancel: &Cancel,
    ) -> Result<SkeletonOutcome, SkeletonError> {
        let FactoredTask { domain, problem, .. } = &self.merged;
        let outcome = planner::plan(domain, problem, options, cancel).map_err(without_member)?;
        match (outcome.plan, outcome.stop_reason) {
            (Some(plan), _) => Ok(SkeletonOutcome::Found(self.split(&plan)?)),
            (None, StopReason::Unsolvable { .. }) => Ok(SkeletonOutcome::NoPlan),
            (None, limit) => Ok(SkeletonOutcome::Undecided(limit)),
        }
    }

    /// Splits a skeleton by member: its own steps, and in between what others change, as far as the
    /// member knows it.
    fn split(&self, plan: &Plan) -> Result<SkeletonPlan, SkeletonError> {
        let FactoredTask { domain, problem, .. } = &self.merged;
        let problem_of = |why: String| SkeletonError { member: None, why };
        let start = World::initial(domain, problem)
            .map_err(|_| problem_of("the merged task makes no sense".to_owned()))?;
        let mut now = start.clone();
        let mut owners = Vec::new();
        let mut parts: BTreeMap<String, (Vec<PartStep>, World)> = BTreeMap::new();
        for step in &plan.steps {
            let owner = self
                .owner(step)
                .ok_or_else(|| problem_of(format!("no member has announced `{}`", step.action)))?;
            let (part, since) = parts
                .entry(owner.clone())
                .or_insert_with(|| (self.unstated(&owner), start.clone()));
            part.extend(self.changes(&owner, since, &now));
            part.push(PartStep::Own(step.to_string()));
            now.apply(step).map_err(|fault| problem_of(fault.to_string()))?;
            since.clone_from(&now);
            owners.push(owner);
        }
        for (member, (part, since)) in &mut parts {
            part.extend(self.changes(member, since, &now));
        }
        let texts: String = plan.steps.iter().map(|step| format!("{step}\n")).collect();
        let digest = format!("{:016x}", Fnv64::default().with(texts.as_bytes()).value());
        let parts = parts.into_iter().map(|(owner, (part, _))| (owner, part)).collect();
        Ok(SkeletonPlan { owners, parts, digest })
    }

    /// Returns what only others state of the initial state and the member knows the names of: the
    /// beginning of its part.
    fn unstated(&self, member: &str) -> Vec<PartStep> {
        let Some(names) = self.known.get(member) else { return Vec::new() };
        let init = self.merged.problem.init.iter();
        let news = init.filter(|it| names.know(it)).map(ToString::to_string);
        let news: Vec<String> = news.filter(|text| !names.stated.contains(text)).collect();
        if news.is_empty() { Vec::new() } else { vec![PartStep::Others(news.join(" "))] }
    }

    fn owner(&self, step: &PlanStep) -> Option<String> {
        let owner = self.known.iter().find(|(_, names)| names.actions.contains(&step.action));
        owner.map(|(member, _)| member.clone())
    }

    /// Returns the changes between two states that a member knows, as PDDL; `None` if there are none.
    fn changes(&self, member: &str, from: &World, to: &World) -> Option<PartStep> {
        let names = self.known.get(member)?;
        let changes = from.changes_to(to).into_iter().filter(|change| names.know(change));
        let texts: Vec<String> = changes.map(|change| change.to_string()).collect();
        (!texts.is_empty()).then(|| PartStep::Others(texts.join(" ")))
    }
}

// === impl MemberNames ===

impl MemberNames {
    fn of(files: &AgentFiles) -> MemberNames {
        let AgentFiles { domain, problem, .. } = files;
        let predicates = domain.predicates.iter().map(|it| it.name.clone());
        let functions = domain.functions.iter().map(|it| it.name.clone());
        let constants = domain.constants.iter().map(|it| it.name.clone());
        let objects = problem.objects.iter().map(|it| it.object.name.clone());
        MemberNames {
            actions: domain.actions.iter().map(|it| it.name.clone()).collect(),
            symbols: predicates.chain(functions).collect(),
            objects: constants.chain(objects).collect(),
            stated: problem.init.iter().map(ToString::to_string).collect(),
        }
    }

    /// Whether all names in a change are known.
    fn know(&self, change: &InitElement) -> bool {
        let (symbol, arguments): (&Name, &[Term]) = match change {
            InitElement::Atom(atom) | InitElement::Not(atom) | InitElement::Unknown(atom) => {
                (&atom.predicate, &atom.arguments)
            }
            // The cost of the whole plan is not that of the member.
            InitElement::Assign(fluent, _) if fluent.function == *TOTAL_COST => return false,
            InitElement::Assign(fluent, _) => (&fluent.function, &fluent.arguments),
            InitElement::At(_, inner) => return self.know(inner),
        };
        self.symbols.contains(symbol)
            && arguments.iter().all(|term| self.objects.contains(term.name()))
    }
}

/// Parses the projection of a member.
///
/// # Errors
///
/// Returns the reason, as text for a person, if it is too long or cannot be parsed, or if an action
/// is not named for the member.
fn parsed(member: &str, projection: &Projection) -> Result<AgentFiles, String> {
    if projection.domain.len() + projection.problem.len() > PROJECTION_BYTES_MAX {
        return Err(format!("its projection has more than {PROJECTION_BYTES_MAX} bytes"));
    }
    let first = |found: Vec<pddl::Diagnostic>| {
        let first = found.first().map(ToString::to_string).unwrap_or_default();
        format!("its projection cannot be read: {first}")
    };
    let domain: Domain = pddl::parse_domain(&projection.domain).into_result().map_err(first)?;
    let problem = pddl::parse_problem(&projection.problem).into_result().map_err(first)?;
    check_member_name(member)?;
    let prefix = format!("{member}{OWN}");
    let files = AgentFiles { agent: member.to_owned(), domain, problem };
    let mut actions = files.domain.actions.iter().map(|it| it.name.as_str());
    if let Some(foreign) = actions.find(|it| !it.starts_with(&prefix)) {
        return Err(format!("its action `{foreign}` is not named `{prefix}…`"));
    }
    // Names that are used without a declaration count, too: a member must not change private things of
    // another one.
    let texts = format!("{} {}", projection.domain, projection.problem).to_lowercase();
    match opaque_words(&texts).find(|word| !word.starts_with(&prefix)) {
        Some(foreign) => {
            Err(format!("`{foreign}` contains `{OWN}`: only names of its own things may"))
        }
        None => Ok(files),
    }
}

/// Returns the files without goals about objects that no member declares. A goal about a private
/// object of one member may stand in the files of others, under its real name.
fn without_unknown_goals(mut files: Vec<AgentFiles>) -> Vec<AgentFiles> {
    let objects: BTreeSet<Name> =
        files.iter().flat_map(|member| MemberNames::of(member).objects).collect();
    for member in &mut files {
        if let pddl::Condition::And(conjuncts) = &mut member.problem.goal {
            conjuncts.retain(|conjunct| used_by(conjunct).objects.is_subset(&objects));
        }
    }
    files
}

fn without_member(error: PlanError) -> SkeletonError {
    SkeletonError { member: None, why: error.to_string() }
}
