// The mean of a pixel's samples in linear light, as pictures are looked at (spec/scene.md 1); the
// hardware's own resolve averages codes, which makes edges too dark.

uniform sampler2DMS samples;

layout(location = 0) out vec4 pixel;

void main()
{
    vec3 sum = vec3(0.0);
    float covered = 0.0;
    for (int i = 0; i < SAMPLES; i++) {
        vec4 one = texelFetch(samples, ivec2(gl_FragCoord.xy), i);
        sum += decoded(one.rgb);
        covered += one.a;
    }
    pixel = vec4(encoded(sum / float(SAMPLES)), covered / float(SAMPLES));
}
