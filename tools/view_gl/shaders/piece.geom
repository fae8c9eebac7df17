// A source triangle with the normal of its plane, shaded once.

layout(triangles) in;
layout(triangle_strip, max_vertices = 3) out;

in Corner {
    vec3 place;
    flat vec3 colour;
    flat uint slot;
} corner[];

out Face {
    flat uint slot;
    flat vec3 colour;
    flat uvec2 number;
} face;

void main()
{
    vec3 a = corner[0].place, b = corner[1].place, c = corner[2].place;
    vec3 normal = cross(world * (b - a), world * (c - a));
    float size = length(normal);
    normal = size > 0.0 ? normal / size : vec3(0.0);
    vec3 surface = plain;
#ifdef COLOUR
    surface = corner[2].colour;
#endif
    vec3 colour = encoded(shaded(decoded(surface), normal, (a + b + c) / 3.0, 1.0));
    for (int i = 0; i < 3; i++) {
        gl_Position = gl_in[i].gl_Position;
        face.slot = corner[0].slot;
        face.colour = colour;
        face.number = uvec2(0u);
        EmitVertex();
    }
    EndPrimitive();
}
