// Group 0: one frame. Owned by render::frame.

@group(0) @binding(0) var<uniform> frame: FrameUniforms;
// A row per level. A texture, not a buffer: lavapipe reads buffers lane by lane.
@group(0) @binding(1) var lut: texture_2d<f32>;
