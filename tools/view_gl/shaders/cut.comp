// Clears the masks of a block's voxels that stencils cut out, in the pool.

layout(local_size_x = 64) in;
layout(std430, binding = 2) buffer Pool { uint words[]; };
uniform uvec2 run;          // the block's first voxel and how many it has
uniform ivec4 block;        // its low corner in finest voxels from the origin; level

void main()
{
    if (gl_GlobalInvocationID.x >= run.y) return;
    uint at = (run.x + gl_GlobalInvocationID.x) * STRIDE, voxel = words[at];
    ivec3 local = ivec3(voxel & 255u, voxel >> 8 & 255u, voxel >> 16 & 255u);
    if (cut_out(block.xyz + (local << block.w), 1 << block.w)) words[at] = voxel & 0xffffffu;
}
