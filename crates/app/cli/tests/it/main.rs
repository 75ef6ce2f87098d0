//! Commands, in this process and as processes of their own.
#![cfg_attr(not(unix), allow(unused, reason = "some tests are of what Unix systems have alone"))]

mod align;
mod answers;
mod bench;
mod blocks;
mod capture;
mod checkpoints;
mod clean;
#[cfg(unix)]
mod clip;
mod command;
mod compare;
mod compress;
mod configuration;
mod convert;
mod depth_files;
mod device;
mod divergence;
mod dynamic;
mod few_photos;
mod figures;
mod fit;
mod given_cameras;
#[cfg(unix)]
mod heif;
#[cfg(unix)]
mod image;
mod in_process;
mod info;
mod inputs;
#[cfg(unix)]
mod killed;
mod left_behind;
mod lift;
mod lpips;
mod masks;
mod mesh;
#[cfg(feature = "mpi")]
mod mpi;
mod old_names;
mod outputs;
mod pasted;
mod paths;
mod plan;
mod process;
mod published;
mod reconstruct;
mod render;
mod run;
mod settings;
mod teacher;
mod two_experts;
mod units;
mod vad;
mod values;
mod video;
mod view;
mod weights;
mod wild;
