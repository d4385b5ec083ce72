//! What an agent said of itself, taken apart once for all who heard it.

use std::sync::Arc;

use acl::content::Methods;
use pddl::ActionModel;

use crate::declined::Declined;
use crate::manifest::Manifest;

/// A model and its methods. Cheap to clone: it outlives heartbeats and lives, and the maintainers
/// of one process share it.
#[derive(Clone, Debug)]
pub(crate) struct Described {
    pub(crate) digest: Arc<str>,
    /// The model as it was written, but for its facts and actions: those are in the manifest.
    pub(crate) frame: Arc<ActionModel>,
    /// The model, taken apart.
    pub(crate) manifest: Arc<Manifest>,
    pub(crate) methods: Arc<Methods>,
}

impl Described {
    /// Takes a model apart.
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
