//! Layers, optimiser, schedules and weight averaging on the weaver-autograd tape.
