// SRAA, first half (thesis, 4.10): the voxel at the pixel's first sample, shaded once.

uniform usampler2DMS numbers;       // of the voxel in the pool, from 1; of its block's record

layout(std430, binding = 1) readonly buffer Records { int records[]; };
layout(std430, binding = 2) readonly buffer Pool { uint words[]; };

layout(location = 0) out vec4 pixel;

void main()
{
    uvec2 number = texelFetch(numbers, ivec2(gl_FragCoord.xy), 0).xy;
    if (number.x == 0u) {
        pixel = vec4(0.0);
        return;
    }
    uint at = (number.x - 1u) * STRIDE, record = number.y * 6u;
    uint voxel = words[at];
    int level = records[record + 3u];
    ivec3 local = ivec3(voxel & 255u, voxel >> 8 & 255u, voxel >> 16 & 255u);
    ivec3 low = ivec3(records[record], records[record + 1u], records[record + 2u])
        + (local << level);
    vec3 surface = plain;
#ifdef COLOUR
    surface = unpackUnorm4x8(words[at + STRIDE - 1u]).rgb;
#endif
    vec3 normal = vec3(0.0);
#ifdef LIT
    normal = unit_normal(words[at + 1u]);
#endif
    pixel = vec4(voxel_colour(low, 1 << level, level, surface, normal), 1.0);
}
