// Unpacks a voxel: place, the faces that the eye can see, colour (Chajdas 2014, 4.3.2).
// It is shaded here, once: its attributes are the same all over it, and fragments are many more. With
// SRAA it is not: only its number is drawn, and numbered.frag looks the voxel up.

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
uniform bool whole;     // a voxel of which any face is seen shows all that are turned to the eye

out Voxel {
    flat ivec3 low;
    flat int edge;
    flat uint faces;
    flat uint slot;
    flat vec3 colour;       // sRGB, shaded
    flat uvec2 number;      // of the voxel in the pool, from 1, and of its block's record
#ifdef DEFORM
    flat bool probe;
#endif
} made;

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
    // A probe stands for voxels that may be there where it is not.
    if (draw.y != 1u && (mask == 0u || CUT_HERE == 1 && cut_out(made.low, made.edge))) made.faces = 0u;
#endif
    made.slot = draw.x;
#ifdef DEFORM
    made.probe = draw.y == 1u;
#endif
#ifdef SPRITES
    place_sprite(made.low, made.edge, made.faces != 0u);
#endif
    if (made.faces == 0u) return;
#ifdef SRAA
    made.number = uvec2(gl_VertexID + 1, draw.x);
#elif !defined(DEPTHS)
    vec3 surface = plain;
#ifdef COLOUR
    surface = colour.rgb;
#endif
    vec3 direction = vec3(0.0);
#ifdef LIT
    direction = unit_normal(normal);
#endif
    made.colour = voxel_colour(made.low, made.edge, block.w, surface, direction);
#endif
}
