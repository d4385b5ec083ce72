//! One plan of a goal, with its steps.

use std::collections::BTreeMap;

use acl::content::{Execute, Outcome};

use crate::moment::Moment;
use crate::rows::StepState;
use crate::text::{GroundStep, cut};

/// Maximum length of a plan that is read, in bytes; of a longer one the first steps are.
const PLAN_BYTES_MAX: usize = 1 << 20;

/// One step of a plan.
#[derive(Clone, Debug)]
pub(crate) struct StepRecord {
    pub(crate) step: GroundStep,
    pub(crate) state: StepState,
    pub(crate) started_at: Option<Moment>,
    pub(crate) ended_at: Option<Moment>,
    pub(crate) detail: String,
    /// Whether an agent has reported how it ended, so that its time is known.
    pub(crate) is_timed: bool,
}

impl StepRecord {
    pub(crate) fn next(step: GroundStep) -> StepRecord {
        StepRecord {
            step,
            state: StepState::Next,
            started_at: None,
            ended_at: None,
            detail: String::new(),
            is_timed: false,
        }
    }

    pub(crate) fn is_over(&self) -> bool {
        !matches!(self.state, StepState::Next | StepState::Running)
    }

    pub(crate) fn end(&mut self, at: Moment, state: StepState) {
        self.state = state;
        self.ended_at = Some(at);
    }
}

/// Number of a plan: the term of its Plan Requester, and its number in that term.
pub(crate) type PlanNumber = (u64, u32);

#[derive(Clone, Debug)]
pub(crate) struct PlanRecord {
    pub(crate) number: PlanNumber,
    /// Whether only a report about the plan was observed, which tells neither term nor number.
    pub(crate) is_sketch: bool,
    pub(crate) cost: Option<f64>,
    pub(crate) made_at: Moment,
    pub(crate) ended_at: Option<Moment>,
    pub(crate) outcome: Option<Outcome>,
    pub(crate) because: String,
    pub(crate) steps: BTreeMap<u32, StepRecord>,
    /// Number of all steps, with those that are not kept.
    pub(crate) count: u32,
    /// Bytes of the steps, roughly.
    pub(crate) bytes: usize,
}

impl PlanRecord {
    /// Creates a plan of which no step is known.
    pub(crate) fn new(at: Moment, number: PlanNumber) -> PlanRecord {
        PlanRecord {
            number,
            is_sketch: false,
            cost: None,
            made_at: at,
            ended_at: None,
            outcome: None,
            because: String::new(),
            steps: BTreeMap::new(),
            count: 0,
            bytes: 0,
        }
    }

    /// Takes the steps of the plan. Steps that were observed before keep their state.
    pub(crate) fn set_steps(&mut self, steps: Vec<GroundStep>, steps_max: usize) {
        self.count = self.count.max(u32::try_from(steps.len()).unwrap_or(u32::MAX));
        for (number, step) in (0..).zip(steps.into_iter().take(steps_max)) {
            if !self.steps.contains_key(&number) {
                self.bytes += step.bytes();
                self.steps.insert(number, StepRecord::next(step));
            }
        }
    }

    /// Returns a step, a new one if it was not known: the observer may have come late.
    pub(crate) fn step(
        &mut self,
        number: u32,
        step: &GroundStep,
        steps_max: usize,
    ) -> Option<&mut StepRecord> {
        if !self.steps.contains_key(&number) && self.steps.len() >= steps_max {
            return None;
        }
        self.count = self.count.max(number.saturating_add(1));
        if !self.steps.contains_key(&number) {
            self.bytes += step.bytes();
        }
        Some(self.steps.entry(number).or_insert_with(|| StepRecord::next(step.clone())))
    }

    /// Ends the plan, unless it has ended.
    pub(crate) fn end(&mut self, at: Moment, outcome: Outcome, because: &str) {
        if self.ended_at.is_some() {
            return;
        }
        self.ended_at = Some(at);
        self.outcome = Some(outcome);
        because.clone_into(&mut self.because);
        for step in self.steps.values_mut().filter(|step| !step.is_over()) {
            let state = match outcome {
                Outcome::Done => StepState::Done,
                _ => StepState::Cancelled,
            };
            step.end(at, state);
        }
    }

    pub(crate) fn done(&self) -> u32 {
        let done = self.steps.values().filter(|step| step.state == StepState::Done).count();
        u32::try_from(done).unwrap_or(u32::MAX)
    }

    /// Whether the plan has exactly these steps.
    pub(crate) fn has_steps(&self, steps: &[GroundStep]) -> bool {
        let known = self.steps.values().map(|record| &record.step);
        known.zip(steps).all(|(one, other)| one == other)
            && usize::try_from(self.count).is_ok_and(|count| count == steps.len())
    }
}

/// Returns the steps of a plan, under the agents' own names for their actions.
pub(crate) fn steps_of(execute: &Execute, text_bytes: usize) -> Vec<GroundStep> {
    let mut steps = parse_plan(&execute.plan, text_bytes);
    for step in &mut steps {
        let offers = step.arguments.first().and_then(|agent| execute.offers.get(agent.as_str()));
        let own = offers.and_then(|offers| {
            let mut offers = offers.iter();
            offers.find(|(_, offer)| offer.schema == step.action).map(|(name, _)| name.clone())
        });
        if let Some(own) = own {
            step.action = own;
        }
    }
    steps
}

/// Parses the steps of a plan. Names are cut to a length.
pub(crate) fn parse_plan(text: &str, text_bytes: usize) -> Vec<GroundStep> {
    let plan = pddl::parse_plan(head(text, PLAN_BYTES_MAX)).value.unwrap_or_default();
    let mut steps: Vec<_> = plan.steps.iter().map(GroundStep::of).collect();
    let names = steps
        .iter_mut()
        .flat_map(|step| std::iter::once(&mut step.action).chain(step.arguments.iter_mut()));
    for name in names.filter(|name| name.len() > text_bytes) {
        *name = cut(name, text_bytes);
    }
    steps
}

/// Returns the first lines of a text, of at most `bytes_max` bytes together.
pub(crate) fn head(text: &str, bytes_max: usize) -> &str {
    if text.len() <= bytes_max {
        return text;
    }
    let end = text.bytes().take(bytes_max).rposition(|byte| byte == b'\n');
    &text[..end.unwrap_or(0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_head_of_a_text_has_whole_lines() {
        assert_eq!(head("(a)\n(b)\n", 9), "(a)\n(b)\n");
        assert_eq!(head("(a)\n(b)\n", 7), "(a)");
        assert_eq!(head("(ä)", 2), "");
    }
}
