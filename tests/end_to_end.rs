//! End-to-end tests: the program `althing` in real processes, over Zenoh.
//!
//! They are one target, so that the test support and its libraries are compiled and linked once.
//! Targets of their own are `load` and `faults`, which need the machine for themselves, and
//! `confinement`, where plugins attack their surroundings.

mod arms;
mod backups;
mod buildings;
mod cameras;
#[path = "support/cast_device.rs"]
mod cast_device;
#[path = "../daemon/views/web-page/tests/browser/chromium.rs"]
mod chromium;
mod commands;
mod doctor;
mod documented_commands;
mod due;
mod federation;
#[path = "support/film.rs"]
#[allow(dead_code, reason = "what tests of the plugin need besides")]
mod film;
mod first_steps;
mod gateway;
mod history;
mod homes;
mod interfacing;
mod joint;
#[path = "support/kernel.rs"]
mod kernel;
mod keyboard;
mod knowing;
mod languages;
mod metrics;
mod neighbors;
mod notifications;
mod pages;
mod people;
mod plugins;
mod privacy;
mod programs;
mod reality;
mod recording;
mod robots;
mod safeguards;
mod scenario;
mod screens;
mod security;
mod sensors;
mod service;
mod stops;
mod stranger;
mod support;
mod traces;
mod views;
mod web;
mod words;

// The browser's file, which tests of several crates share, finds it here.
use support::left_out;
