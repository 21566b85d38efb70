// Values of samples straight from the atlas.

fn value_at(source: Source, index: i32) -> f32 {
    return sample_value(source.brick, source_offset(source, f32(index)));
}
