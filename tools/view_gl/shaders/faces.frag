// A fragment of a face: its block can be seen, and it has the voxel's colour (thesis, 4.5.2).

layout(early_fragment_tests) in;

in Face {
    flat uint slot;
    flat vec3 colour;
    flat uvec2 number;
} face;

#ifdef OCCLUSION
layout(std430, binding = 0) writeonly buffer Flags { uint flags[]; };
#endif

#ifdef SRAA
layout(location = 0) out uvec2 number;
#else
layout(location = 0) out vec4 pixel;
#endif

void main()
{
#ifdef OCCLUSION
    flags[face.slot] = 1u;      // no atomic is needed: all write the same
#endif
#ifdef SRAA
    number = face.number;
#else
    pixel = vec4(face.colour, 1.0);
#endif
}
