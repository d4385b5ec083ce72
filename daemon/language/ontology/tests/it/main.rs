//! Tests of the standard ontology, of its extension, and of the maps that are made from plans.

mod maps;
mod standard;
mod vocabularies;
