// Depth alone; of a probe also whether a fragment of it can be seen.

layout(early_fragment_tests) in;

in Face {
    flat uint slot;
    flat vec3 colour;
    flat uvec2 number;
} face;

#ifdef OCCLUSION
layout(std430, binding = 0) writeonly buffer Flags { uint flags[]; };
#endif

void main()
{
#ifdef OCCLUSION
    flags[face.slot] = 1u;
#endif
}
