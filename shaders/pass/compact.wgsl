// Technique multipass, between two passes of the caster: lists the rays that go on, without those that are finished and
// those that wait for a brick (techniques.md T4.1).
//
// A work-group keeps the order of its pixels, so that neighbours stay neighbours. The order among work-groups is the one in
// which they come, and differs from run to run: rays know nothing of each other, and each is listed once.

@group(1) @binding(0) var<storage, read_write> rays: array<RayState>;
// FEEDBACK_LIVE counts the list's pixels.
@group(1) @binding(1) var<storage, read_write> feedback: array<atomic<u32>>;
// Pixels that are looked at: the host's list, or that of the pass before.
@group(1) @binding(2) var pixel_list: texture_2d<u32>;
@group(2) @binding(0) var live_list: texture_storage_2d<r32uint, write>;
// Work-groups that the list takes, for indirect dispatches.
@group(3) @binding(0) var<storage, read_write> live_groups: array<u32, 3>;

// A pixel that is in no tile.
const COMPACT_NONE: u32 = 0xffffffffu;

// A bit per invocation: its ray goes on. Enough for the largest work-group there is.
var<workgroup> compact_bits: array<atomic<u32>, 32>;
// Place in the list of the work-group's first pixel.
var<workgroup> compact_first: u32;

fn compact_store(place: u32, pixel: u32) {
    let wide = textureDimensions(live_list).x;
    textureStore(live_list, vec2u(place % wide, place / wide), vec4u(pixel, 0u, 0u, 0u));
}

// How many of the first `count` invocations go on.
fn compact_count(count: u32) -> u32 {
    var sum = 0u;
    for (var word = 0u; word < count / 32u; word++) {
        sum += countOneBits(atomicLoad(&compact_bits[word]));
    }
    let rest = count & 31u;
    if rest != 0u {
        sum += countOneBits(atomicLoad(&compact_bits[count >> 5u]) & ((1u << rest) - 1u));
    }
    return sum;
}

// Appends the pixels of a work-group's live rays to the list.
fn compact_append(index: u32, tile_pixel: vec2u, is_live: bool) {
    if is_live {
        atomicOr(&compact_bits[index >> 5u], 1u << (index & 31u));
    }
    workgroupBarrier();
    if index == 0u {
        compact_first = atomicAdd(&feedback[FEEDBACK_LIVE], compact_count(GROUP_WIDTH * GROUP_HEIGHT));
    }
    let first = workgroupUniformLoad(&compact_first);
    if is_live {
        compact_store(first + compact_count(index), (tile_pixel.y << 16u) | tile_pixel.x);
    }
}

// Before the first pass: the unfinished rays of the host's work-groups. Those that waited try again.
@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn compact_begin(
    @builtin(workgroup_id) id: vec3u,
    @builtin(local_invocation_id) local: vec3u,
) {
    let group = cast_order(FEEDBACK_GROUPS + id.x);
    let tile_pixel = cast_tile_pixel(group, local, cast_order(FEEDBACK_PIXELS) != 0u);
    let at = cast_number(tile_pixel);
    let flags = rays[at].flags;
    let is_live = !cast_is_outside(tile_pixel) && (flags & RAY_FINISHED) == 0u;
    if is_live && (flags & RAY_STOPPED) != 0u {
        rays[at].flags = flags & ~RAY_STOPPED;
    }
    compact_append(cast_index(local), tile_pixel, is_live);
}

// Before another pass: what is left of the pass before.
@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn compact_rays(
    @builtin(workgroup_id) id: vec3u,
    @builtin(local_invocation_id) local: vec3u,
) {
    let tile_pixel = cast_tile_pixel(id.x, local, true);
    let flags = rays[cast_number(tile_pixel)].flags;
    let is_live = !cast_is_outside(tile_pixel) && (flags & (RAY_FINISHED | RAY_STOPPED)) == 0u;
    compact_append(cast_index(local), tile_pixel, is_live);
}

// After either, by one work-group: how many work-groups the list takes; the last is filled up with pixels that are none.
@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn compact_end(@builtin(local_invocation_id) local: vec3u) {
    let size = GROUP_WIDTH * GROUP_HEIGHT;
    let index = cast_index(local);
    let count = atomicLoad(&feedback[FEEDBACK_LIVE]);
    let groups = (count + size - 1u) / size;
    if count + index < groups * size {
        compact_store(count + index, COMPACT_NONE);
    }
    // All have read the count before it is set back.
    storageBarrier();
    if index == 0u {
        live_groups = array<u32, 3>(groups, 1u, 1u);
        atomicStore(&feedback[FEEDBACK_LIVE], 0u);
    }
}
