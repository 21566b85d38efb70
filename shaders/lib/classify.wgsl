// Colour (straight) and opacity of a stored value: the level's table of classify::Lut, linear between entries.

fn classify_value(grid: Grid, value: f32) -> vec4f {
    let x = clamp((value - frame.lut_lo) * frame.lut_scale, 0.0, frame.lut_last);
    let low = min(floor(x), frame.lut_last - 1.0);
    let f = x - low;
    let at = vec2i(i32(low), i32(grid.level));
    let a = textureLoad(lut, at, 0);
    return a + (textureLoad(lut, at + vec2i(1, 0), 0) - a) * f;
}
