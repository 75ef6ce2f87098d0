//! The shaders without a device: they are WGSL, need no more than WebGPU promises, and have no barrier that some
//! threads of a work group may miss.

use crate::uniformity;
use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{AddressSpace, Module};
use weaver_gpu::{SHADERS, Shader};

fn parsed(shader: &Shader) -> Module {
    let source = shader.source();
    naga::front::wgsl::parse_str(&source)
        .unwrap_or_else(|error| panic!("{}: {}", shader.file(), error.emit_to_string(&source)))
}

#[test]
fn every_shader_is_valid_without_extensions() {
    for shader in &SHADERS {
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
        let module = parsed(shader);
        validator.validate(&module).unwrap_or_else(|error| panic!("{}: {error:?}", shader.file()));
        assert!(module.entry_points.iter().any(|entry| entry.name == shader.entry), "{}", shader.file());
        assert!(!shader.source().contains("enable "), "{}", shader.file());
    }
}

/// WebGPU promises 8 storage buffers a stage, 16 KiB of shared memory, 256 threads, 64 KiB uniforms.
#[test]
fn every_shader_is_within_the_limits() {
    for shader in &SHADERS {
        let module = parsed(shader);
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).unwrap();
        let bytes = |space: fn(&AddressSpace) -> bool| -> u32 {
            let variables = module.global_variables.iter().filter(|(_, variable)| space(&variable.space));
            variables.map(|(_, variable)| layouter[variable.ty].size).sum()
        };
        let file = shader.file();
        let storage =
            module.global_variables.iter().filter(|(_, v)| matches!(v.space, AddressSpace::Storage { .. })).count();
        assert!(storage <= 8, "{file}: {storage} storage buffers");
        let shared = bytes(|space| matches!(space, AddressSpace::WorkGroup));
        assert!(shared <= 16_384, "{file}: {shared} bytes of shared memory");
        for entry in &module.entry_points {
            let threads: u32 = entry.workgroup_size.iter().product();
            assert!(threads <= 256, "{file}: {threads} threads");
        }
    }
}

#[test]
fn barriers_are_reached_by_all_threads() {
    for shader in &SHADERS {
        let faults = uniformity::faults(&parsed(shader));
        assert!(faults.is_empty(), "{}: {faults:?}", shader.file());
    }
}

/// The walk finds errors that browsers refuse: barriers under conditions on the thread, and behind a return of some.
#[test]
fn barriers_that_some_threads_miss_are_found() {
    let shader = |body: &str| {
        let text = format!(
            "@group(0) @binding(0) var<storage, read_write> out: array<u32>;\n\
             @group(0) @binding(1) var<storage, read> given: array<u32>;\n\
             var<workgroup> shared_count: u32;\n\
             fn wait() {{ workgroupBarrier(); }}\n\
             @compute @workgroup_size(64)\n\
             fn main(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) group: vec3<u32>) {{ {body} }}"
        );
        uniformity::faults(&naga::front::wgsl::parse_str(&text).unwrap()).len()
    };
    for refused in [
        "if (lane < 32u) { workgroupBarrier(); }",
        "if (lane < 32u) { wait(); }",
        "if (lane < 32u) { return; } workgroupBarrier();",
        "for (var i = 0u; i < lane; i++) { workgroupBarrier(); }",
        "for (var i = 0u; i < out[0]; i++) { workgroupBarrier(); }",
        "for (var i = 0u; i < given[lane]; i++) { workgroupBarrier(); }",
        "var n = 1u; if (lane == 3u) { n = 2u; } for (var i = 0u; i < n; i++) { workgroupBarrier(); }",
        "loop { if (lane == 0u) { break; } workgroupBarrier(); }",
        "if (shared_count > 1u) { workgroupBarrier(); }",
    ] {
        assert_eq!(shader(refused), 1, "{refused}");
    }
    for accepted in [
        "workgroupBarrier(); wait();",
        "for (var i = 0u; i < given[group.x]; i++) { workgroupBarrier(); }",
        "if (workgroupUniformLoad(&shared_count) > 1u) { workgroupBarrier(); }",
        "if (lane < 32u) { out[lane] = 1u; } workgroupBarrier();",
        "for (var i = 0u; i < 4u; i++) { for (var j = 0u; j < lane; j++) { if (j == 3u) { break; } } wait(); }",
    ] {
        assert_eq!(shader(accepted), 0, "{accepted}");
    }
}
