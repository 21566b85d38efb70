// Cuts each ray to parts: sorts what it crosses, keeps what all half spaces and all closed meshes keep, and lists the layers of
// the meshes that are drawn. The twin is clip::Geometry::spans.
//
// A point is inside a closed mesh where the mesh winds around it. The winding is counted from the far end, where it is 0:
// what lies in front of the near plane, which no raster tells, doesn't matter.

// Per pixel of the tile: number of its first record, and how many it has.
@group(2) @binding(0) var lists: texture_storage_2d<rg32uint, write>;
@group(2) @binding(1) var records: texture_storage_2d<rgba32uint, write>;

// What is sorted at a time; of rays that cross more the rest follows in further rounds.
const SORTED: u32 = 32u;

// The order of crossings.
struct CrossingKey {
    mm: f32,
    mesh: u32,
    triangle: u32,
}

struct WorldRay {
    origin: vec3f,
    direction: vec3f,
    near_mm: f32,
    // Distance = this · depth along the view direction, or that of the cube's face.
    stretch: f32,
    // Of the list of what it crosses.
    head: u32,
}

// How far a crossing may lie from where the raster has it, as a part of its distance: rays of a panorama don't pass through the
// middles of the cube's pixels.
fn parts_slack() -> f32 {
    return select(1e-3, 5e-2, PANORAMA != PANORAMA_NONE);
}

// The face of the cube that a direction meets, and where.
fn parts_of_cube(ray: ptr<function, WorldRay>) {
    let direction = (*ray).direction;
    let size = abs(direction);
    var axis = select(select(2u, 1u, size.y >= size.z), 0u, size.x >= size.y && size.x >= size.z);
    let ahead = direction[axis];
    let side = select(-1.0, 1.0, ahead > 0.0);
    let across = -side * direction[(axis + 1u) % 3u] / abs(ahead);
    let upward = direction[(axis + 2u) % 3u] / abs(ahead);
    let edge = f32(geometry.cube_edge);
    let pixel = vec2u(clamp(vec2f(across + 1.0, 1.0 - upward) * 0.5 * edge, vec2f(0.0), vec2f(edge - 1.0)));
    let face = 2u * axis + select(1u, 0u, ahead > 0.0);
    (*ray).head = (face * geometry.cube_edge + pixel.y) * geometry.cube_edge + pixel.x;
    (*ray).stretch = 1.0 / abs(ahead);
}

override ORTHOGRAPHIC: bool = false;
// Records have a second texel (lib/part.wgsl).
override FACES: bool = false;

// The list that is written.
struct Parts {
    base: u32,
    count: u32,
    // What the half spaces keep, mm.
    kept: vec2f,
    // Where the part began that is kept, and whether behind a layer.
    begin_mm: f32,
    continues: bool,
    // The face there, if a cut made one: its normal, towards the eye.
    face: vec3f,
    // That of the half space at which what all of them keep begins.
    kept_face: vec3f,
    // Where the last record ends, if it is of a part without a layer behind it, and how that began.
    closed_mm: f32,
    closed_begin_mm: f32,
    closed_continues: bool,
    closed_face: vec3f,
}

// What is thinner, as a part of its distance, is rounding.
const PARTS_THIN: f32 = 1e-6;

fn parts_ray(pixel: vec2u) -> WorldRay {
    let plane = ray_plane(vec2f(pixel));
    let world = ray_world(plane);
    let stretch = sqrt(dot(world, world));
    let origin = geometry.origin[0].xyz + geometry.origin[1].xyz * plane.x + geometry.origin[2].xyz * plane.y;
    let tile_pixel = pixel - frame.tile_origin;
    let head = tile_pixel.y * frame.tile_size.x + tile_pixel.x;
    var ray = WorldRay(origin, world / stretch, frame.near_mm * stretch, select(stretch, 1.0, ORTHOGRAPHIC), head);
    if PANORAMA != PANORAMA_NONE {
        parts_of_cube(&ray);
    }
    return ray;
}

// What all half spaces keep of a ray.
fn parts_keep(ray: WorldRay, parts: ptr<function, Parts>) {
    var kept = vec2f(ray.near_mm, 1e30);
    let planes = atomicLoad(&part_words[PARTS_PLANES]);
    for (var k = 0u; k < planes; k++) {
        let plane = half_spaces[k];
        let distance = dot(plane.xyz, ray.origin) + plane.w;
        let slope = dot(plane.xyz, ray.direction);
        let at = -distance / slope;
        if slope > 0.0 {
            if at > kept.x {
                kept.x = at;
                (*parts).kept_face = -plane.xyz;
            }
        } else if slope < 0.0 {
            kept.y = min(kept.y, at);
        } else if distance < 0.0 {
            kept.y = -1e30;
        }
    }
    (*parts).kept = kept;
}

fn parts_key(ray: WorldRay, crossing: Crossing) -> CrossingKey {
    let plane = triangle_planes[crossing.triangle];
    let slope = dot(plane.xyz, ray.direction);
    // Seen from the side its plane tells nothing: the raster does, to a thousandth. All that it drew lies behind the near
    // plane, so that the crossings of a closed mesh stay balanced.
    let about = crossing.depth_mm * ray.stretch;
    let at = -(dot(plane.xyz, ray.origin) + plane.w) / select(slope, 1e-20, abs(slope) < 1e-20);
    let slack = abs(about) * parts_slack();
    let near_about = clamp(at, about - slack, about + slack);
    return CrossingKey(max(near_about, ray.near_mm), crossing.mesh, crossing.triangle);
}

// By distance, then mesh, then triangle.
fn parts_before(a: CrossingKey, b: CrossingKey) -> bool {
    let mesh_a = a.mesh & ~CROSSING_ENTERS;
    let mesh_b = b.mesh & ~CROSSING_ENTERS;
    return a.mm < b.mm || (a.mm == b.mm && (mesh_a < mesh_b || (mesh_a == mesh_b && a.triangle < b.triangle)));
}

fn parts_is_kept(windings: ptr<function, array<i32, MOST_CLIP_MESHES>>) -> bool {
    let clip_meshes = atomicLoad(&part_words[PARTS_CLIP_MESHES]);
    for (var k = 0u; k < clip_meshes; k++) {
        if ((*windings)[k] != 0) != (meshes[k].kind == MESH_INSIDE) {
            return false;
        }
    }
    return true;
}

fn parts_store(place: u32, record: vec4u) {
    textureStore(records, vec2u(place % PART_RECORDS_WIDE, place / PART_RECORDS_WIDE), record);
}

fn parts_write(parts: ptr<function, Parts>, begin_mm: f32, continues: bool, end_mm: f32, layer: vec4f, face: vec3f) {
    let place = (*parts).base + (*parts).count;
    (*parts).count += 1u;
    if place < geometry.most_records {
        let begin = bitcast<u32>(begin_mm) | select(0u, 1u << 31u, continues);
        let packed = vec2u(pack2x16unorm(layer.rg), pack2x16unorm(layer.ba));
        parts_store(place * select(1u, 2u, FACES), vec4u(begin, bitcast<u32>(end_mm), packed));
        if FACES {
            parts_store(place * 2u + 1u, vec4u(bitcast<vec3u>(face), 0u));
        }
    }
}

// The part up to `to_mm` ends, behind it a layer, if it has opacity.
fn parts_end(parts: ptr<function, Parts>, is_kept: bool, to_mm: f32, layer: vec4f) {
    let is_cut = (*parts).begin_mm < (*parts).kept.x;
    let begin_mm = max((*parts).begin_mm, (*parts).kept.x);
    let end_mm = min(to_mm, (*parts).kept.y);
    let has_volume = is_kept && end_mm - begin_mm > end_mm * PARTS_THIN;
    let reaches = has_volume && end_mm == to_mm;
    if has_volume {
        let face = select((*parts).face, (*parts).kept_face, is_cut);
        let behind = select(vec4f(0.0), layer, reaches);
        parts_write(parts, begin_mm, (*parts).continues && !is_cut, end_mm, behind, face);
    }
    (*parts).closed_mm = select(-1.0, end_mm, has_volume && layer.a == 0.0);
    (*parts).closed_begin_mm = (*parts).begin_mm;
    (*parts).closed_continues = (*parts).continues;
    (*parts).closed_face = (*parts).face;
    if layer.a > 0.0 && !reaches {
        parts_write(parts, 1e30, false, to_mm, layer, vec3f(0.0));
    }
}

// A part begins at a cut face. Where shells touch, one is left where another is entered, or nearly so: nothing is cut there, and
// the part before goes on.
fn parts_open(parts: ptr<function, Parts>, at_mm: f32, face: vec3f) {
    let touches = (*parts).closed_mm >= 0.0 && at_mm - (*parts).closed_mm <= at_mm * PARTS_THIN;
    (*parts).count -= select(0u, 1u, touches);
    (*parts).begin_mm = select(at_mm, (*parts).closed_begin_mm, touches);
    (*parts).continues = touches && (*parts).closed_continues;
    (*parts).face = select(face, (*parts).closed_face, touches);
}

// The layer of a triangle: lit, premultiplied colour, and opacity.
fn parts_layer(ray: WorldRay, key: CrossingKey) -> vec4f {
    let at = 6u * (key.triangle - geometry.first_drawn);
    let corner = triangle_corners[at].xyz;
    let side = triangle_corners[at + 1u].xyz - corner;
    let other = triangle_corners[at + 2u].xyz - corner;
    // Barycentric coordinates of the point by areas.
    let normal = cross(side, other);
    let point = ray.origin + ray.direction * key.mm - corner;
    let scale = 1.0 / max(dot(normal, normal), 1e-30);
    let weights = clamp(vec2f(dot(cross(point, other), normal), dot(cross(side, point), normal)) * scale, vec2f(0.0), vec2f(1.0));
    let smooth_normal = triangle_corners[at + 3u].xyz * max(1.0 - weights.x - weights.y, 0.0)
        + triangle_corners[at + 4u].xyz * weights.x + triangle_corners[at + 5u].xyz * weights.y;
    let color = meshes[key.mesh & ~CROSSING_ENTERS].color;
    return vec4f(shade_phong(color.rgb, smooth_normal, ray.direction), 1.0) * color.a;
}

@compute @workgroup_size(8, 8)
fn make_parts(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.part_size) {
        return;
    }
    let ray = parts_ray(frame.tile_origin + id.xy);
    let clip_meshes = atomicLoad(&part_words[PARTS_CLIP_MESHES]);
    var head = 0u;
    if atomicLoad(&part_words[PARTS_TRIANGLES]) > 0u {
        head = atomicLoad(&crossing_heads[ray.head]);
    }
    var windings: array<i32, MOST_CLIP_MESHES>;
    // What ends the ray.
    var wall = CrossingKey(2e30, 0u, 0u);
    var node = head;
    while node != 0u {
        let crossing = crossings[node - 1u];
        let key = parts_key(ray, crossing);
        let mesh = crossing.mesh & ~CROSSING_ENTERS;
        if mesh < clip_meshes {
            windings[mesh] -= select(-1, 1, (crossing.mesh & CROSSING_ENTERS) != 0u);
        } else if meshes[mesh].color.a >= 1.0 && parts_before(key, wall) {
            wall = key;
        }
        node = crossing.next;
    }
    var count = 0u;
    node = head;
    while node != 0u {
        let crossing = crossings[node - 1u];
        let key = parts_key(ray, crossing);
        count += u32(!parts_before(wall, key));
        node = crossing.next;
    }

    var parts: Parts;
    // A layer behind what half spaces keep takes two records.
    parts.base = atomicAdd(&part_words[PARTS_RECORDS], 2u * count + 1u);
    parts_keep(ray, &parts);
    parts.begin_mm = ray.near_mm;
    parts.closed_mm = -1.0;
    var is_kept = parts_is_kept(&windings);
    var keys: array<CrossingKey, SORTED>;
    // Only what follows this one is left.
    var done = CrossingKey(-1.0, 0u, 0u);
    var left = count;
    var has_ended = false;
    while left > 0u {
        var sorted = 0u;
        node = head;
        while node != 0u {
            let crossing = crossings[node - 1u];
            let key = parts_key(ray, crossing);
            node = crossing.next;
            if parts_before(wall, key) || !parts_before(done, key) {
                continue;
            }
            if sorted == SORTED && !parts_before(key, keys[SORTED - 1u]) {
                continue;
            }
            var place = min(sorted, SORTED - 1u);
            while place > 0u && parts_before(key, keys[place - 1u]) {
                keys[place] = keys[place - 1u];
                place -= 1u;
            }
            keys[place] = key;
            sorted = min(sorted + 1u, SORTED);
        }
        if sorted == 0u {
            break;
        }
        for (var k = 0u; k < sorted; k++) {
            let key = keys[k];
            let mesh = key.mesh & ~CROSSING_ENTERS;
            if mesh < clip_meshes {
                windings[mesh] += select(-1, 1, (key.mesh & CROSSING_ENTERS) != 0u);
                let keeps = parts_is_kept(&windings);
                if is_kept && !keeps {
                    parts_end(&parts, true, key.mm, vec4f(0.0));
                }
                if keeps && !is_kept {
                    let normal = triangle_planes[key.triangle].xyz;
                    parts_open(&parts, key.mm, select(normal, -normal, dot(normal, ray.direction) > 0.0));
                }
                is_kept = keeps;
            } else {
                let layer = parts_layer(ray, key);
                parts_end(&parts, is_kept, key.mm, layer);
                // A face that is cut and drawn is cut behind its layer.
                let is_at_cut = any(parts.face != vec3f(0.0)) && key.mm - parts.begin_mm <= key.mm * PARTS_THIN;
                parts.begin_mm = key.mm;
                parts.continues = !is_at_cut;
                parts.face = select(vec3f(0.0), parts.face, is_at_cut);
                has_ended |= layer.a >= 1.0;
            }
        }
        done = keys[sorted - 1u];
        left -= min(left, sorted);
    }
    if !has_ended {
        parts_end(&parts, is_kept, 1e30, vec4f(0.0));
    }
    textureStore(lists, id.xy, vec4u(parts.base, parts.count, 0u, 0u));
}
