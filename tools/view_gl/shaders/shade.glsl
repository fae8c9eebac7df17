// The colour of a voxel, the same all over it: attributes are not interpolated.

uniform float ambient;
uniform vec3 plain;                 // colour of what has none
#ifdef TINT
uniform vec3 tints[6];              // by level
#endif
#ifdef LIT
uniform vec4 lights[LIGHTS];        // towards a directional light, w = 0; place from the origin, w = 1
uniform vec3 intensities[LIGHTS];
uniform int normal_bits;
#ifdef SPECULAR
uniform vec2 specular;              // strength, exponent
#endif
#ifdef SHADOW
uniform mat4 light_clip[SHADOW];
uniform float light_bias[SHADOW];   // along the normal, in finest voxels
uniform sampler2DShadow depths;     // the lights' maps side by side
#endif

// What of light i comes to a place, 0 to 1.
float unblocked(int i, vec3 place)
{
#ifdef SHADOW
    if (i < SHADOW) {
        vec4 at = light_clip[i] * vec4(displaced(place), 1.0);
        vec3 map = at.xyz / at.w * 0.5 + 0.5;
        if (at.w > 0.0 && all(equal(map, clamp(map, 0.0, 1.0))))
            return texture(depths, vec3((map.x + float(i)) / float(SHADOW), map.yz));
    }
#endif
    return 1.0;
}
#endif

// spec/scene.md 2.4, in linear light.
vec3 shaded(vec3 colour, vec3 normal, vec3 centre, float edge)
{
    vec3 sum = ambient * colour;
#ifdef LIT
    vec3 place = world * centre;
    vec3 view = normalize(world * (parallel ? eye : eye - centre));
    for (int i = 0; i < LIGHTS; i++) {
        vec3 towards = lights[i].w == 0.0 ? lights[i].xyz : lights[i].xyz - place;
        vec3 light = normalize(towards);
        vec3 turned = normal == vec3(0.0) ? light : normal;
        float cosine = dot(turned, light);
        if (cosine <= 0.0) continue;
        vec3 comes = intensities[i] / (lights[i].w == 0.0 ? 1.0 : dot(towards, towards));
#ifdef SHADOW
        comes *= unblocked(i, centre + max(light_bias[min(i, SHADOW - 1)], edge) * turned);
#endif
        sum += comes * colour * cosine;
#ifdef SPECULAR
        sum += comes * specular.x
            * pow(max(dot(turned, normalize(light + view)), 0.0), specular.y);
#endif
    }
#endif
    return sum;
}

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

// The sRGB colour of a voxel of that level, surface as stored, normal 0 where it has none.
vec3 voxel_colour(ivec3 low, int edge, int level, vec3 surface, vec3 normal)
{
#ifdef TINT
    surface = tints[level % 6];
#endif
    vec3 centre = vec3(low) + 0.5 * float(edge);
    return encoded(shaded(decoded(surface), normal, centre, float(edge)));
}
