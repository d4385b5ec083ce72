//! Dry runs of goals: plans in this process, on the domain, the state and the goals that two queries
//! return. No agent is asked for anything.

use std::sync::LazyLock;
use std::time::Duration;

use acl::content::{GoalStatus, Snapshot};
use agent::Resource;
use keyboard::GoalRequest;
use plan_requester::{DryRunRequest, DryRunResult};
use planner::Cancel;
use tokio::sync::Semaphore;

use crate::ecosystem_view::EcosystemView;

/// Maximum number of dry runs that plan at a time in one process. A board has few cores, and its
/// agents need one.
const AT_ONCE_MAX: usize = 1;

/// How long a dry run waits until it may begin. A person looks at the page meanwhile.
const TURN_WITHIN: Duration = Duration::from_secs(10);

static TURNS: LazyLock<Semaphore> = LazyLock::new(|| Semaphore::new(AT_ONCE_MAX));

/// Plans for a goal in the present state of the ecosystem without requesting it.
///
/// # Errors
///
/// Returns an error if the state of the ecosystem cannot be learnt, or if other dry runs take too
/// long. The text completes the sentence “failed to …”.
pub(crate) async fn dry_run(
    view: &EcosystemView,
    wish: &GoalRequest,
) -> Result<DryRunResult, String> {
    let turn = tokio::time::timeout(TURN_WITHIN, TURNS.acquire()).await;
    let _turn = turn.map_err(|_| "plan: other dry runs are still planning; try again")?;
    let (maintainer, requester) = (&view.roles().domain_maintainer, &view.roles().plan_requester);
    view.directory(Some(maintainer)).await;
    let (domain, goals) = tokio::join!(
        view.ask(Resource::Domain, Some(maintainer.clone())),
        view.ask(Resource::Goals, Some(requester.clone())),
    );
    let snapshot = domain.first().and_then(|bytes| serde_json::from_slice::<Snapshot>(bytes).ok());
    let snapshot = snapshot.ok_or("reach a Domain Maintainer: none is present")?;
    // Without a Plan Requester, no goals are pursued that the plan could undo.
    let goals = goals.first().and_then(|bytes| serde_json::from_slice(bytes).ok());
    let goals: Vec<GoalStatus> = goals.unwrap_or_default();
    let request = DryRunRequest { goal: wish.goal.clone(), priority: wish.priority };
    let (cancel, deadline) = (Cancel::new(), view.router.settings().planning_deadline);
    let flag = cancel.clone();
    let mut planning = tokio::task::spawn_blocking(move || {
        plan_requester::dry_run(snapshot, &goals, &request, &flag)
    });
    let planned = match tokio::time::timeout(deadline, &mut planning).await {
        Ok(planned) => planned,
        Err(_) => {
            // The planner tests the flag all the time, and ends soon.
            cancel.set();
            planning.await
        }
    };
    planned.map_err(|error| format!("plan: the planner has ended: {error}"))
}
