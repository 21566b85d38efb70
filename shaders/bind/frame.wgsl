// Group 0: one frame. Owned by render::frame.

@group(0) @binding(0) var<uniform> frame: FrameUniforms;
@group(0) @binding(1) var<storage, read> lut: array<vec4f>;
