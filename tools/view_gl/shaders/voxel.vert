// Unpacks a voxel: place, the faces that the eye can see, colour (Chajdas 2014, 4.3.2).
// It is shaded here, once: its attributes are the same all over it, and fragments are many more.

in uint voxel;          // x | y << 8 | z << 16 | mask << 24, in the block
#ifdef LIT
in uint normal;         // octahedral codes x | y << 16
#endif
#ifdef COLOUR
in vec4 colour;
#endif
in ivec4 block;         // its low corner in finest voxels from the origin; level
in uvec2 draw;          // slot of its flag; 1 = a probe: all faces, as what it stands for may show any

uniform int last;       // greatest coordinate in a block
uniform int normal_bits;
uniform bool whole;     // a voxel of which any face is seen shows all that are turned to the eye
uniform vec3 plain;     // colour of what has none
#ifdef TINT
uniform vec3 tints[6];  // by level
#endif

out Voxel {
    flat ivec3 low;
    flat int edge;
    flat uint faces;
    flat uint slot;
    flat vec3 colour;       // sRGB, shaded
} made;

#ifdef LIT
// The unit vector of two octahedral codes (spec/blockfile.md 8.3), 0 where there is no direction.
vec3 unit_normal(uint codes)
{
    ivec2 code = ivec2(codes & 0xffffu, codes >> 16);
    int half_range = (1 << normal_bits - 1) - 1;
    if (all(equal(code, ivec2((1 << normal_bits) - 1)))) return vec3(0.0);
    ivec2 p = code - half_range;
    int z = half_range - abs(p.x) - abs(p.y);
    if (z < 0) p = (half_range - abs(p.yx)) * ivec2(p.x < 0 ? -1 : 1, p.y < 0 ? -1 : 1);
    return normalize(vec3(p, z));
}
#endif

void main()
{
    ivec3 local = ivec3(voxel & 255u, voxel >> 8 & 255u, voxel >> 16 & 255u);
    uint mask = voxel >> 24 & 63u;
    made.edge = 1 << block.w;
    made.low = block.xyz + (local << block.w);
    uint turned = facing(made.low, made.edge);
    bool all_turned = draw.y == 1u || whole && (mask & turned) != 0u;
    made.faces = all_turned ? turned : mask & turned;
#ifdef SKIRTS
    // Faces on the block's border are closed: a neighbour of another level may not reach them.
    made.faces |= turned & (uint(local.x == 0) | uint(local.x == last) << 1 | uint(local.y == 0) << 2
        | uint(local.y == last) << 3 | uint(local.z == 0) << 4 | uint(local.z == last) << 5);
#endif
#ifdef STENCIL
    if (cut_out(made.low, made.edge)) made.faces = 0u;
#endif
    made.slot = draw.x;
#ifdef SPRITES
    place_sprite(made.low, made.edge, made.faces != 0u);
#endif
    if (made.faces == 0u) return;
#ifndef DEPTHS
    vec3 surface = plain;
#ifdef COLOUR
    surface = colour.rgb;
#endif
#ifdef TINT
    surface = tints[block.w % 6];
#endif
    vec3 direction = vec3(0.0);
#ifdef LIT
    direction = unit_normal(normal);
#endif
    vec3 centre = vec3(made.low) + 0.5 * float(made.edge);
    made.colour = encoded(shaded(decoded(surface), direction, centre, float(made.edge)));
#endif
}
