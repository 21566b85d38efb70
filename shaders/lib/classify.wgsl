// Colour (straight) and opacity of a stored value: the level's table of classify::Lut, linear between entries.

fn classify_value(grid: Grid, value: f32) -> vec4f {
    let x = clamp((value - frame.lut_lo) * frame.lut_scale, 0.0, frame.lut_last);
    let low = min(floor(x), frame.lut_last - 1.0);
    let f = x - low;
    let i = grid.lut_offset + u32(low);
    let a = lut[i];
    return a + (lut[i + 1u] - a) * f;
}
