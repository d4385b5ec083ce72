//! stub
#![allow(missing_docs, dead_code)]
pub(crate) type KnownPlugin = (&'static str, &'static [&'static str]);
pub(crate) const KNOWN_PLUGINS: &[KnownPlugin] = &[];
#[derive(Default)]
pub(crate) struct Overrides;
pub(crate) struct Ecosystem {
    pub(crate) warnings: crate::report::Report,
    pub(crate) agents: Vec<u8>,
    pub(crate) daemons: Vec<u8>,
    pub(crate) name: String,
}
pub(crate) struct LoadError(crate::report::Report);
impl LoadError {
    pub(crate) fn into_report(self) -> crate::report::Report {
        self.0
    }
}
impl Ecosystem {
    pub(crate) fn load(
        _: &std::path::Path,
        _: &Overrides,
        _: &[KnownPlugin],
    ) -> Result<Ecosystem, LoadError> {
        Err(LoadError(Default::default()))
    }
}
