// Regions that are cut out: voxels whose centre lies in one are not drawn.

#ifdef STENCIL
uniform vec4 cut_spheres[STENCIL];  // centre from the origin's place, radius; radius 0: a box
uniform vec3 cut_boxes[STENCIL];    // its half edges

bool cut_out(ivec3 low, int edge)
{
    vec3 centre = world * (vec3(low) + 0.5 * float(edge));
    for (int i = 0; i < STENCIL; i++) {
        vec3 from = centre - cut_spheres[i].xyz;
        float radius = cut_spheres[i].w;
        if (radius > 0.0 ? dot(from, from) <= radius * radius
                         : all(lessThanEqual(abs(from), cut_boxes[i])))
            return true;
    }
    return false;
}
#endif
