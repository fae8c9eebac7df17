// One face for each axis on which a voxel has one (Chajdas 2014, 4.3.2): three invocations.
// With a deformation both faces of an axis may be turned to the eye.

#ifdef DEFORM
#define SIDES 2
#else
#define SIDES 1
#endif

layout(points, invocations = 3) in;
layout(triangle_strip, max_vertices = 4 * SIDES) out;

in Voxel {
    flat ivec3 low;
    flat int edge;
    flat uint faces;
    flat uint slot;
    flat vec3 colour;
    flat uvec2 number;
} voxel[];

out Face {
    flat uint slot;
    flat vec3 colour;
    flat uvec2 number;
} face;

void main()
{
    int axis = gl_InvocationID, u = (axis + 1) % 3, v = (axis + 2) % 3;
    uint bits = voxel[0].faces >> 2 * axis & 3u;
    for (int side = 0; side < 2; side++) {
        if ((bits >> side & 1u) == 0u) continue;
        for (int i = 0; i < 4; i++) {
            ivec3 corner = voxel[0].low;
            corner[axis] += side * voxel[0].edge;
            corner[u] += (i & 1) * voxel[0].edge;
            corner[v] += (i >> 1) * voxel[0].edge;
            gl_Position = projected(corner);
            face.slot = voxel[0].slot;
            face.colour = voxel[0].colour;
            face.number = voxel[0].number;
            EmitVertex();
        }
        EndPrimitive();
    }
}
