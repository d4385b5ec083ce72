//! An announced model, divided into its parts once for all maintainers of a process.

use std::sync::Arc;

use acl::content::Methods;
use pddl::ActionModel;

use crate::declined::Declined;
use crate::model_summary::ModelSummary;

/// A model and its methods. It is cheap to clone, because it is kept across heartbeats and incarnations,
/// and the maintainers of one process share it.
#[derive(Clone, Debug)]
pub(crate) struct ParsedModel {
    pub(crate) digest: Arc<str>,
    /// The model as written, without its facts and actions, which are in `manifest`.
    pub(crate) frame: Arc<ActionModel>,
    /// Summary of the model, which has its declarations, actions and facts.
    pub(crate) manifest: Arc<ModelSummary>,
    pub(crate) methods: Arc<Methods>,
}

impl ParsedModel {
    /// Divides a model into its parts.
    ///
    /// Returns an error if the model exceeds a limit.
    pub(crate) fn of(
        mut model: ActionModel,
        methods: Methods,
        digest: &str,
    ) -> Result<ParsedModel, Declined> {
        let manifest = ModelSummary::of_model(&mut model)?;
        Ok(ParsedModel {
            digest: digest.into(),
            frame: Arc::new(model),
            manifest: Arc::new(manifest),
            methods: Arc::new(methods),
        })
    }
}
