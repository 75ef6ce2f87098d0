//! Scenes, captures, view sampling, and the procedural scene generator.
