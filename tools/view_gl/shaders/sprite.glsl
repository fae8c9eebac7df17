// A voxel as a point large enough to cover it; ray against box in the fragment shader.
uniform vec2 viewport;  // pixels

void place_sprite(ivec3 low, int edge, bool seen)
{
    // The box around a projected cube: its middle and what its edges add, at the least depth.
    vec4 middle = clip * vec4(vec3(low) + 0.5 * float(edge), 1.0);
    mat3x4 edges = mat3x4(clip) * (0.5 * float(edge));
    vec4 reach = abs(edges[0]) + abs(edges[1]) + abs(edges[2]);
    float nearest = middle.w - reach.w;
    if (!seen || nearest <= 0.0) {
        gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
        gl_PointSize = 1.0;
        return;
    }
    // A point whose middle is not in the viewport is not drawn at all: its part in it has its own.
    vec2 at = middle.xy / middle.w;
    vec2 side = (reach.xy + abs(at) * reach.w) / nearest;
    vec2 low_end = max(at - side, -1.0), high_end = min(at + side, 1.0);
    vec2 size = max(high_end - low_end, 0.0) * viewport / 2.0;
    gl_Position = vec4((low_end + high_end) / 2.0, 0.0, 1.0);
    gl_PointSize = max(size.x, size.y) + 1.0;
}
