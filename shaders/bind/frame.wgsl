// Group 0: one frame. Owned by render::frame.

@group(0) @binding(0) var<uniform> frame: FrameUniforms;
// A row per level. A texture, not a buffer: lavapipe reads buffers lane by lane.
@group(0) @binding(1) var lut: texture_2d<f32>;
// A table of integrals per level: premultiplied colour and opacity of a segment, by the values in front (x) and in the back
// (y). One texel where nothing is pre-integrated.
@group(0) @binding(2) var preintegrated: texture_2d_array<f32>;
