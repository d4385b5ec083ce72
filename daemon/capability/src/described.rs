//! An announced model, taken apart once for all maintainers of a process.

use std::sync::Arc;

use acl::content::Methods;
use pddl::ActionModel;

use crate::declined::Declined;
use crate::manifest::Manifest;

/// A model and its methods. Cheap to clone: it is kept across heartbeats and incarnations, and the
/// maintainers of one process share it.
#[derive(Clone, Debug)]
pub(crate) struct Described {
    pub(crate) digest: Arc<str>,
    /// The model as written, without its facts and actions: those are in the manifest.
    pub(crate) frame: Arc<ActionModel>,
    /// The model, taken apart.
    pub(crate) manifest: Arc<Manifest>,
    pub(crate) methods: Arc<Methods>,
}

impl Described {
    /// Takes a model apart.
    ///
    /// Returns an error if the model exceeds a limit.
    pub(crate) fn of(
        mut model: ActionModel,
        methods: Methods,
        digest: &str,
    ) -> Result<Described, Declined> {
        let manifest = Manifest::of_model(&mut model)?;
        Ok(Described {
            digest: digest.into(),
            frame: Arc::new(model),
            manifest: Arc::new(manifest),
            methods: Arc::new(methods),
        })
    }
}
