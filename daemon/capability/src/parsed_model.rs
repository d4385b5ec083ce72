//! An announced model, taken apart once for all maintainers of a process.

use std::sync::Arc;

use acl::content::Methods;
use pddl::ActionModel;

use crate::declined::Declined;
use crate::model_summary::ModelSummary;

/// A model and its methods. Cheap to clone: it is kept across heartbeats and incarnations, and the
/// maintainers of one process share it.
#[derive(Clone, Debug)]
pub(crate) struct ParsedModel {
    pub(crate) digest: Arc<str>,
    /// The model as written, without its facts and actions: those are in the manifest.
    pub(crate) frame: Arc<ActionModel>,
    /// The model, taken apart.
    pub(crate) manifest: Arc<ModelSummary>,
    pub(crate) methods: Arc<Methods>,
}

impl ParsedModel {
    /// Takes a model apart.
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
