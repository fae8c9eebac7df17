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
#ifdef DEFORM
    flat bool probe;
#endif
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
#ifdef DEFORM
            // A probe bounds what is in it, which moves as curves between the corners.
            vec3 away = sign(vec3(corner - voxel[0].low) - 0.5 * float(voxel[0].edge));
            float grown = voxel[0].probe ? slack * float(voxel[0].edge * voxel[0].edge) : 0.0;
            gl_Position = clip * vec4(displaced(vec3(corner)) + grown * away, 1.0);
#else
            gl_Position = projected(corner);
#endif
            face.slot = voxel[0].slot;
            face.colour = voxel[0].colour;
            face.number = voxel[0].number;
            EmitVertex();
        }
        EndPrimitive();
    }
}
