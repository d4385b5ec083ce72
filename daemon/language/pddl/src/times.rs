//! Sorting of the steps of plans with times.

use crate::diagnostic::Diagnostic;
use crate::tree::{Plan, PlanStep};

impl Plan {
    /// Sorts the steps by start time; steps with the same time keep their order. A step without a
    /// time stays after its predecessor in the text. Returns a warning for every step with the same
    /// time as the previous step.
    ///
    /// ```
    /// let mut plan = pddl::parse_plan("5: (last) 1: (first) 1: (second)").into_result().unwrap();
    /// let warnings = plan.sort_by_time();
    /// let actions: Vec<&str> = plan.steps.iter().map(|step| step.action.as_str()).collect();
    /// assert_eq!(actions, ["first", "second", "last"]);
    /// assert_eq!(warnings.len(), 1);
    /// ```
    pub fn sort_by_time(&mut self) -> Vec<Diagnostic> {
        let mut time = f64::NEG_INFINITY;
        let steps = std::mem::take(&mut self.steps).into_iter();
        let mut timed: Vec<(f64, PlanStep)> = steps
            .map(|step| {
                time = step.time.map_or(time, |time| time.0);
                (time, step)
            })
            .collect();
        timed.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        let mut warnings = Vec::new();
        for pair in timed.windows(2) {
            let ((one, before), (other, step)) = (&pair[0], &pair[1]);
            if let (Some(time), true) = (step.time, one == other) {
                let message = format!(
                    "`{}` has the same time as `{}`, {time}: the order in the file is kept",
                    step.action, before.action
                );
                warnings.push(Diagnostic::warning(step.span, message));
            }
        }
        self.steps = timed.into_iter().map(|(_, step)| step).collect();
        warnings
    }
}
