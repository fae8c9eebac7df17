// What every program shares: where a lattice point is, and which faces of a voxel can be seen.
// Coordinates are finest voxels relative to an integer origin near the eye, so that shared corners
// are the same numbers, and floats hold them exactly, whatever block or level they come from.

uniform mat4 clip;      // those coordinates to clip coordinates
uniform vec3 eye;       // of a parallel projection: the direction towards the eye
uniform bool parallel;
uniform mat3 world;     // grid to world, without its origin

#ifdef DEFORM
uniform mat3 shear;     // x -> x + shear (x - pivot) + wave sin(waves (x - pivot) + phase)
uniform vec3 pivot;
uniform vec3 wave;
uniform vec3 waves;
uniform float phase;
uniform float slack;    // of a cube of edge 1: how far points of it may leave its corners' hull
#endif

vec3 displaced(vec3 point)
{
#ifdef DEFORM
    // A function of the point alone: voxels that share a corner share it still.
    vec3 from = point - pivot;
    return point + shear * from + wave * sin(dot(waves, from) + phase);
#else
    return point;
#endif
}

vec4 projected(ivec3 point)
{
    return clip * vec4(displaced(vec3(point)), 1.0);
}

// Bits 0 to 5 = -x +x -y +y -z +z: the faces that are turned to the eye, at most one per axis.
uint facing(ivec3 low, int edge)
{
#ifdef DEFORM
    vec3 half_edge = vec3(0.5 * float(edge)), middle = vec3(low) + half_edge;
    uint turned = 0u;
    for (int face = 0; face < 6; face++) {
        int axis = face >> 1;
        vec3 across = vec3(0.0), u = vec3(0.0), v = vec3(0.0);
        across[axis] = half_edge.x * float(2 * (face & 1) - 1);
        u[(axis + 1) % 3] = half_edge.x;
        v[(axis + 2) % 3] = half_edge.x;
        vec3 at = middle + across, place = displaced(at);
        vec3 normal = cross(displaced(at + u) - displaced(at - u), displaced(at + v) - displaced(at - v));
        vec3 towards = parallel ? eye : eye - place;
        if (dot(normal, towards) * across[axis] > 0.0) turned |= 1u << face;
    }
    return turned;
#else
    vec3 near = vec3(low), far = vec3(low + edge);
    bvec3 below = parallel ? lessThan(eye, vec3(0.0)) : lessThan(eye, near);
    bvec3 above = parallel ? greaterThan(eye, vec3(0.0)) : greaterThan(eye, far);
    return uint(below.x) | uint(above.x) << 1 | uint(below.y) << 2 | uint(above.y) << 3
        | uint(below.z) << 4 | uint(above.z) << 5;
#endif
}
