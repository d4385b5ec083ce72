//! Applies the actions of a plan: finds the action of a step, checks that it is applicable, and
//! collects its effects.

use pddl::{ActionSchema, Name, PlanStep, Typed};

use super::FaultReason;
use super::compiled::CompiledAction;
use super::effects::StepChanges;
use super::failing_part::FailingPartSearch;
use super::model::Model;
use super::query::WorldView;
use super::symbols::Object;
use super::world::World;

// === impl World ===

impl World {
    /// Finds the action of a step, checks the step's arguments and precondition, and evaluates the
    /// effects.
    pub(super) fn changes(&self, step: &PlanStep) -> Result<StepChanges, FaultReason> {
        let mut reason = FaultReason::UnknownAction;
        if self.model.is_durative(&step.action) {
            reason = FaultReason::Durative;
        }
        // Action names may be overloaded; the reported fault is that of the last action tried.
        for index in self.model.named(&step.action) {
            match self.changes_by(*index, step) {
                Ok(changes) => return Ok(changes),
                Err(err) => reason = err,
            }
        }
        Err(reason)
    }

    fn changes_by(&self, index: usize, step: &PlanStep) -> Result<StepChanges, FaultReason> {
        let action = &self.model.actions[index];
        let schema = self.model.schema(index);
        let mut frame = self.frame(action, schema, step)?;
        let holds = WorldView::of(self).holds(&schema.precondition, &mut frame);
        if let Some(limit) = self.work_limit_reached() {
            return Err(FaultReason::WorkLimit { limit });
        }
        if !holds {
            let mut failing = FailingPartSearch::new(self);
            failing.bind(action.all_parameters().zip(&step.arguments));
            let part = failing.part(&action.precondition);
            return Err(FaultReason::Precondition(
                part.unwrap_or_else(|| action.precondition.clone()),
            ));
        }
        let mut changes = StepChanges::default();
        WorldView::of(self).collect(&schema.effect, &mut frame, &mut changes)?;
        Ok(changes)
    }

    /// Returns a frame with the parameters of an action bound to the arguments of a step. Returns
    /// an error if the number of arguments, an object or a type is wrong.
    fn frame(
        &self,
        action: &ActionSchema,
        schema: &CompiledAction,
        step: &PlanStep,
    ) -> Result<Vec<Object>, FaultReason> {
        let (expected, found) = (schema.parameters.len(), step.arguments.len());
        if expected != found {
            return Err(FaultReason::ArgumentCount { expected, found });
        }
        let mut frame = Vec::with_capacity(schema.slot_count);
        let parameters = action.all_parameters().zip(&schema.parameters);
        for ((parameter, extension), name) in parameters.zip(&step.arguments) {
            let Some(object) = self.model.objects.declared(name) else {
                return Err(FaultReason::UnknownObject(name.clone()));
            };
            if !extension.contains(object) {
                let expected = parameter.ty.clone();
                return Err(FaultReason::WrongType { object: name.clone(), expected });
            }
            frame.push(object);
        }
        frame.resize(schema.slot_count, Object::UNBOUND);
        Ok(frame)
    }
}

/// Returns the first action with the step's name and number of arguments and with parameter types
/// that accept the arguments; `None` if there is none.
pub(super) fn schema_of<'m>(model: &'m Model, step: &PlanStep) -> Option<&'m ActionSchema> {
    let actions = model.named(&step.action).iter().map(|index| &model.actions[*index]);
    let mut fitting = actions.filter(|action| {
        let fits = |(parameter, object): (&Typed, &Name)| model.is_a(object, &parameter.ty);
        action.all_parameters().count() == step.arguments.len()
            && action.all_parameters().zip(&step.arguments).all(fits)
    });
    fitting.next()
}
