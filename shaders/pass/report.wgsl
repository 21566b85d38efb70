// Which rays are not finished, told once after the last of several passes: where each pass told it, what an early one found
// would stand beside what a later one did.

@group(1) @binding(0) var<storage, read_write> rays: array<RayState>;
@group(1) @binding(1) var<storage, read_write> feedback: array<atomic<u32>>;
@group(1) @binding(2) var pixel_list: texture_2d<u32>;

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn report_rays(
    @builtin(workgroup_id) id: vec3u,
    @builtin(local_invocation_id) local: vec3u,
) {
    let group = cast_order(FEEDBACK_GROUPS + id.x);
    let tile_pixel = cast_tile_pixel(group, local, cast_order(FEEDBACK_PIXELS) != 0u);
    let at = cast_number(tile_pixel);
    let flags = rays[at].flags;
    if !cast_is_outside(tile_pixel) && (flags & RAY_FINISHED) == 0u {
        cast_pending(at, group, (flags & RAY_STOPPED) != 0u);
    }
}
