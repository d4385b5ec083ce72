//! Combining: joins the plans of several bidders into one plan that works.

use pddl::{Condition, Plan, PlanStep};
use planner::merge::merge;

use crate::first;
use crate::planning_snapshot::PlanningSnapshot;

/// Maximum number of states that are examined for an order in which several plans work together.
/// Only steps that threaten each other are tried in several orders.
const MERGED_STATES_MAX: usize = 300;

impl PlanningSnapshot {
    /// Parses the plans of several agents, and returns their steps with the action names of the
    /// composite domain.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if a plan cannot be parsed, or if the action of a
    /// step is avoided or not offered.
    pub(crate) fn read_plans(&self, plans: &[&str]) -> Result<Vec<Vec<PlanStep>>, String> {
        let read = |text: &&str| {
            let plan = pddl::parse_plan(text).into_result().map_err(first)?;
            plan.steps.into_iter().map(|step| self.inside(step)).collect()
        };
        plans.iter().map(read).collect()
    }

    /// Joins the plans of several agents into one plan that reaches `goal`, and returns it with its
    /// cost. The plans follow each other in their order if that works; otherwise their steps are
    /// merged.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text for a person, why the plans do not work one after the other, if
    /// no other order was found either.
    pub(crate) fn combine(&self, plans: &[&str], goal: &Condition) -> Result<(Plan, f64), String> {
        let plans = self.read_plans(plans)?;
        let joined = Plan { steps: plans.concat(), cost: None };
        let fault = match self.validate(&joined, goal) {
            Ok(cost) => return Ok((joined, cost)),
            Err(fault) => fault,
        };
        if plans.len() < 2 {
            return Err(fault);
        }
        let sure = self.sure(goal);
        let world = self.world()?;
        world.renew_work();
        let Some(steps) = merge(world, &plans, &sure, MERGED_STATES_MAX) else {
            return Err(fault);
        };
        let merged = Plan { steps, cost: None };
        self.validate(&merged, goal).map(|cost| (merged, cost))
    }
}
