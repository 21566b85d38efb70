#[cfg(feature = "gpu")]
fn main() {
    use std::time::Instant;
    use wgpu::util::DeviceExt;
    let a: Vec<String> = std::env::args().skip(1).filter(|w| w != "--bench").collect();
    let raw = std::fs::read(&a[0]).unwrap();
    let src = std::fs::read_to_string(&a[1]).unwrap();
    let n = 256u32;
    let gpu = brickscope::gpu::GpuContext::open(&brickscope::gpu::AdapterChoice::SoftwareFirst, true).unwrap();
    let (d, q) = (&gpu.device, &gpu.queue);
    let tex = |dim, format, size: [u32; 3], data: &[u8]| {
        d.create_texture_with_data(q, &wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: size[2] },
            mip_level_count: 1, sample_count: 1, dimension: dim, format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST, view_formats: &[],
        }, wgpu::util::TextureDataOrder::LayerMajor, data)
    };
    use wgpu::TextureFormat as F;
    let t3 = tex(wgpu::TextureDimension::D3, F::R8Unorm, [n, n, n], &raw);
    let ta = tex(wgpu::TextureDimension::D2, F::R8Unorm, [n, n, n], &raw);
    let tu = tex(wgpu::TextureDimension::D2, F::R8Uint, [n, n, n], &raw);
    let lut: Vec<[f32; 4]> = (0..4096).map(|i| { let x = i as f32 / 4095.0; [x, x, x, x * 0.06] }).collect();
    let tl = tex(wgpu::TextureDimension::D2, F::Rgba32Float, [4096, 1, 1], bytemuck::cast_slice(&lut));
    let half: Vec<u8> = lut.iter().flatten().map(|x| (x * 255.0) as u8).collect();
    let tl8 = tex(wgpu::TextureDimension::D2, F::Rgba8Unorm, [4096, 1, 1], &half);
    let buf = |data: &[u8]| d.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents: data, usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC });
    let bl = buf(bytemuck::cast_slice(&lut));
    let bv = buf(&raw);
    let bo = buf(&vec![0; 512 * 512 * 16]);
    let smp = |f| d.create_sampler(&wgpu::SamplerDescriptor { mag_filter: f, min_filter: f, ..Default::default() });
    let (sl, sn) = (smp(wgpu::FilterMode::Linear), smp(wgpu::FilterMode::Nearest));
    let module = d.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source: wgpu::ShaderSource::Wgsl(src.as_str().into()) });
    let names: Vec<String> = src.split("fn k_").skip(1).map(|s| format!("k_{}", s.split('(').next().unwrap())).collect();
    let cpu = || { let s = std::fs::read_to_string("/proc/self/stat").unwrap(); s.rsplit(')').next().unwrap().split_whitespace().skip(11).take(2).map(|x| x.parse::<f64>().unwrap()).sum::<f64>() * 10.0 };
    for name in names {
        if a.len() > 2 && !name.contains(&a[2]) { continue; }
        let p = d.create_compute_pipeline(&wgpu::ComputePipelineDescriptor { label: None, layout: None, module: &module, entry_point: Some(&name), compilation_options: Default::default(), cache: None });
        let v = |t: &wgpu::Texture, dim| t.create_view(&wgpu::TextureViewDescriptor { dimension: Some(dim), ..Default::default() });
        let (v3, va, vl, vl8, vu) = (v(&t3, wgpu::TextureViewDimension::D3), v(&ta, wgpu::TextureViewDimension::D2Array), v(&tl, wgpu::TextureViewDimension::D2), v(&tl8, wgpu::TextureViewDimension::D2), v(&tu, wgpu::TextureViewDimension::D2Array));
        use wgpu::BindingResource as R;
        let all = [R::TextureView(&v3), R::Sampler(&sl), R::Sampler(&sn), bl.as_entire_binding(), R::TextureView(&vl), bo.as_entire_binding(), R::TextureView(&va), bv.as_entire_binding(), R::TextureView(&vl8), R::TextureView(&vu)];
        let body = src.split(&format!("fn {name}(")).nth(1).unwrap();
        let body = body.split("// USES").nth(1).unwrap().lines().next().unwrap();
        let entries: Vec<_> = body.split_whitespace().map(|w| { let b: u32 = w.parse().unwrap(); wgpu::BindGroupEntry { binding: b, resource: all[b as usize].clone() } }).collect();
        let g = d.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &p.get_bind_group_layout(0), entries: &entries });
        let run = || { let mut e = d.create_command_encoder(&Default::default()); { let mut c = e.begin_compute_pass(&Default::default()); c.set_pipeline(&p); c.set_bind_group(0, &g, &[]); c.dispatch_workgroups(64, 64, 1); } q.submit([e.finish()]); gpu.wait().unwrap(); };
        run();
        let out = brickscope::gpu::read_buffers(&gpu, [(&bo, 0, 512 * 512 * 16)]).unwrap();
        let f: Vec<f32> = bytemuck::pod_collect_to_vec(&out[0]);
        let samples: f64 = f.iter().skip(3).step_by(4).map(|&x| f64::from(x)).sum();
        let sum: f64 = f.iter().step_by(4).map(|&x| f64::from(x)).sum();
        let k: usize = std::env::var("K").ok().and_then(|k| k.parse().ok()).unwrap_or(3);
        let (c, w) = (cpu(), Instant::now());
        for _ in 0..k { run(); }
        let ms = (cpu() - c) / k as f64;
        println!("{name:>24} {ms:8.1} cpu ms {:8.1} wall ms {:7.2} Msamples {:6.2} ns/sample, sum {sum:.6}", w.elapsed().as_secs_f64() * 1e3 / k as f64, samples / 1e6, ms * 1e6 / samples);
    }
}
#[cfg(not(feature = "gpu"))]
fn main() {}
