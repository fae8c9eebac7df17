// Marks the blocks that the sprites' picture shows, and clears their numbers for the next frame.

layout(local_size_x = 8, local_size_y = 8) in;
layout(std430, binding = 0) writeonly buffer Flags { uint flags[]; };
layout(r32ui, binding = 0) uniform uimage2D seen;

void main()
{
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, imageSize(seen)))) return;
    uint slot = imageLoad(seen, at).x;
    if (slot == 0u) return;
    flags[slot - 1u] = 1u;
    imageStore(seen, at, uvec4(0u));
}
