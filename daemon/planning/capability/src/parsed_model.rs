//! An announced model that is divided into its parts once for all maintainers of a process.

use std::sync::Arc;

use acl::content::Methods;
use pddl::ActionModel;

use crate::declined::Declined;
use crate::model_summary::ModelSummary;

/// A model and its methods. Cloning is cheap, because the maintainers of a process share the model
/// and keep it across heartbeats and incarnations.
#[derive(Clone, Debug)]
pub(crate) struct ParsedModel {
    pub(crate) digest: Arc<str>,
    /// The model as written, without its facts and actions; `manifest` has these.
    pub(crate) frame: Arc<ActionModel>,
    /// Summary of the model, with its declarations, actions and facts.
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
