// A pixel of a sprite: where its ray enters the voxel, if through a face that the voxel has.

in Voxel {
    flat ivec3 low;
    flat int edge;
    flat uint faces;
    flat uint slot;
    flat vec3 colour;
    flat uvec2 number;
} voxel;

uniform mat3 ray;           // pixel coordinates, 1 -> direction; parallel: -> a point of the ray

layout(location = 0) out vec4 pixel;
#ifdef OCCLUSION
layout(location = 1) out uint seen;
#endif

void main()
{
    vec3 at = ray * vec3(gl_FragCoord.xy, 1.0);
    vec3 from = parallel ? at : eye, along = parallel ? -eye : at;
    // Slabs: neighbours compute the same t for the plane between them, so that no ray slips through.
    vec3 low = (vec3(voxel.low) - from) / along;
    vec3 high = (vec3(voxel.low + voxel.edge) - from) / along;
    vec3 enter = min(low, high), leave = max(low, high);
    float t = max(max(enter.x, enter.y), enter.z);
    if (t > min(min(leave.x, leave.y), leave.z) || t <= 0.0 && !parallel) discard;
    int axis = t == enter.x ? 0 : t == enter.y ? 1 : 2;
    int side = along[axis] < 0.0 ? 1 : 0;
    if ((voxel.faces >> 2 * axis + side & 1u) == 0u) discard;
    vec4 hit = clip * vec4(from + t * along, 1.0);
    gl_FragDepth = hit.z / hit.w * 0.5 + 0.5;
#ifdef OCCLUSION
    seen = voxel.slot + 1u;
#endif
    pixel = vec4(voxel.colour, 1.0);
}
