// Every ray by itself.

// The loops below nest run, brick, sample: what belongs to a run or a brick is done once for it. Software adapters execute
// both sides of every `if`, and a loop's body once more than needed unless it ends in its `break`: hence the shape
// (ARCHITECTURE.md, "Decisions"). A run is never empty.
@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn cast_rays(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_id) local: vec3u,
) {
    var state: RayState;
    var walk: Walk;
    var caster = cast_begin(group, local, &state, &walk);
    var color = vec4f(0.0);
    if !DRAFT {
        color = picture[caster.at];
    }
    var mode = mode_begin(caster, state, color);
    walk.greatest = mode_bound(mode);
    var i = state.next;
    // With LEAP: what the last sample was read from.
    var level = 0u;
    // In the middle of a run, behind something translucent.
    var resumed = false;
    var more = cast_next_run(&caster, &walk, &mode);
    i = cast_moved_on(&caster, &mode, more, i);
    loop {
        while more {
            mode_next_run(&mode, caster);
            caster.part.is_new = false;
            i = select(walk.first, i, resumed);
            resumed = false;
            loop {
                var offset = ray_offset(caster.ray, f32(i));
                let brick = brick_at(caster.ray.grid, offset);
                let source = cast_enter(&caster, brick, f32(i));
                level = source.brick.level;
                if caster.stopped {
                    break;
                }
                // Not behind the dispatch's last sample.
                let last = min(walk.last, i + i32(min(caster.limit - caster.samples, 1u << 30u)) - 1);
                loop {
                    mode_take(&mode, &caster, source, i);
                    if FILTERED_GRADIENTS && caster.stopped {
                        break;
                    }
                    caster.samples += 1u;
                    i += 1;
                    cast_meet(&caster, i, source.brick.level);
                    offset = ray_offset(caster.ray, f32(i));
                    if mode.event || i > last || !brick_contains(brick, offset) {
                        break;
                    }
                }
                caster.paused = !mode.event && caster.samples >= caster.limit;
                if mode.event || caster.paused || caster.stopped || i > walk.last {
                    break;
                }
            }
            walk.greatest = mode_bound(mode);
            more = !mode.event && !caster.stopped && !caster.paused && cast_next_run(&caster, &walk, &mode);
            i = cast_moved_on(&caster, &mode, more, i);
        }
        i = mode_resolve(&mode, &caster, i);
        cast_meet(&caster, i, level);
        if !MANY_EVENTS || !mode.event || mode.ended || caster.stopped {
            break;
        }
        mode.event = false;
        caster.paused = caster.samples >= caster.limit;
        resumed = i <= walk.last;
        more = !caster.paused && (resumed || cast_next_run(&caster, &walk, &mode));
        i = cast_moved_on(&caster, &mode, more, i);
        if !more {
            break;
        }
    }
    cast_end(caster, walk, mode_end(mode, caster, i), i);
}
